"""What keeps the documents and the words in order: generated pages, the check of words.

Nothing that the program needs at run time belongs here, and nothing that measures.
"""
