"""One module per kind of link behind one small protocol."""
