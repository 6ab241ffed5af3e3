"""The systemd unit of a site: what it says, and where it is installed.

Units are text here; nothing in this folder starts or stops a service.
"""

from fieldlink.systemd.installing import Installed, install_unit, next_commands
from fieldlink.systemd.unit import ServiceUnit, unit_of

__all__ = ["Installed", "ServiceUnit", "install_unit", "next_commands", "unit_of"]
