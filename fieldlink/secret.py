"""A password or token: read from a file or the environment, and never shown."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["Secret", "SecretError"]


class SecretError(ValueError):
    """A secret cannot be read; the message says why and never what."""


class Secret:
    """A text that no log, message or representation shows."""

    def __init__(self, text: str) -> None:
        self._text = text

    def reveal(self) -> str:
        """Return the secret itself, where it has to be sent."""
        return self._text

    def __repr__(self) -> str:
        return "***"

    @classmethod
    def of_file(cls, file: Path) -> Secret:
        """Read a file that holds the secret and nothing else.

        Raises:
            SecretError: it cannot be read as text.
        """
        try:
            return cls(file.read_text(encoding="utf-8").strip("\r\n"))
        except (OSError, UnicodeDecodeError) as error:
            raise SecretError(
                f"{file} cannot be read; check its permissions, and that it holds the secret as "
                "plain text"
            ) from error

    @classmethod
    def of_environment(cls, variable: str) -> Secret:
        """Read an environment variable.

        Raises:
            SecretError: it is not set, or empty.
        """
        text = os.environ.get(variable, "")
        if not text:
            raise SecretError(
                f"the environment variable {variable} is not set; set it for the daemon, or name "
                "a file"
            )
        return cls(text)
