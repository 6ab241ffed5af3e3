"""A valve over many windows: tracking, trend and changes; indices of a single window.

Works on finished identifications or plain signals; no search and no likelihood here.
"""
