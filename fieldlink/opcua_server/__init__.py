"""The read-only OPC UA server: `serving` runs it beside the daemon, `process` is the server itself.

What `process` imports must stay small and know nothing of the daemon: it is a process of its own.
"""
