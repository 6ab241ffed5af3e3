"""The process that reads and judges, and the object that watches over it from outside.

Both engines use the same pair; nothing here knows which engine, and nothing decides what is judged.
"""
