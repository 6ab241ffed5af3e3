"""What the pages show, as plain documents: read from the store and from the running daemon.

No HTTP, no HTML and nothing that writes lives here.
"""
