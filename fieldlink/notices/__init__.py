"""Notices to people: a confirmed finding, a device lost or back, over HTTP and by e-mail.

Nothing here judges, polls or writes a device; a receiver that does not answer delays nothing else.
"""

from fieldlink.notices.counts import NoticesReport, ReceiverReport
from fieldlink.notices.errors import NoticeError
from fieldlink.notices.notice import Notice, device_notice, finding_notice, probe_notice
from fieldlink.notices.notifying import Notifying
from fieldlink.notices.receivers import Receiver, receivers_of

__all__ = [
    "Notice",
    "NoticeError",
    "NoticesReport",
    "Notifying",
    "Receiver",
    "ReceiverReport",
    "device_notice",
    "finding_notice",
    "probe_notice",
    "receivers_of",
]
