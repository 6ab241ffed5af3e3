"""Signal dictionaries of SSP 1.0: signals that several systems and components share by name."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

from lxml import etree

__all__ = ["SignalDictionaries"]

_SSB = "{http://ssp-standard.org/SSP1/SystemStructureSignalDictionary}"
_TYPE = "application/x-ssp-signal-dictionary"


class SignalDictionaries:
    """The dictionaries of a whole structure, each known in its system and in those inside it.

    Args:
        file: the archive, for dictionaries beside the structure.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._found: dict[tuple[str, str], dict[str, str]] = {}

    def add(self, path: str, dictionary: Any) -> dict[tuple[str, str], str]:
        """Take in a ``SignalDictionary`` of the system at ``path``.

        Returns:
            The unit of every entry, empty where it has none, by node.

        Raises:
            ValueError: it cannot be read; what and why.
        """
        name = dictionary.get("name")
        root = self._root(dictionary, name)
        entries: dict[str, str] = {}
        for entry in root.iterfind(f"{_SSB}DictionaryEntry"):
            units = [kind.get("unit") for kind in entry if kind.get("unit")]
            entries[entry.get("name")] = units[0] if units else ""
        self._found[path, name] = entries
        return {(_place(path, name), entry): unit for entry, unit in entries.items()}

    def _root(self, dictionary: Any, name: str) -> Any:
        if dictionary.get("type", _TYPE) != _TYPE:
            raise ValueError(
                f"the signal dictionary {name!r} is of the type {dictionary.get('type')}; "
                f"give one of the type {_TYPE}"
            )
        source = dictionary.get("source")
        if source is None:
            root = dictionary.find(f"{_SSB}SignalDictionary")
        else:
            parser = etree.XMLParser(resolve_entities=False, no_network=True)
            try:
                with zipfile.ZipFile(self._file) as archive:
                    root = etree.fromstring(archive.read(source), parser)
            except KeyError as error:
                raise ValueError(f"the signal dictionary {source} is not in the archive") from error
            except etree.XMLSyntaxError as error:
                raise ValueError(
                    f"the signal dictionary {source} is not XML: {error.msg}"
                ) from error
        if root is None or root.tag != f"{_SSB}SignalDictionary":
            raise ValueError(f"the signal dictionary {name!r} has no ssb:SignalDictionary in it")
        return root

    def look_up(self, path: str, name: str) -> str:
        """Return the place of the dictionary that a reference in the system at ``path`` means.

        Raises:
            ValueError: neither that system nor one around it has such a dictionary.
        """
        while (path, name) not in self._found:
            if not path:
                raise ValueError(
                    f"there is no signal dictionary {name!r}; declare it in SignalDictionaries of "
                    "this system or of one around it"
                )
            path = path.rpartition(".")[0]
        return _place(path, name)


def _place(path: str, name: str) -> str:
    """Return a path that no system and no component has."""
    return f"{path or 'the system'}: signal dictionary {name}"
