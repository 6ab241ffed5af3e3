"""Why a loop swings and which loop started it: arrays in, a diagnosis out. No file, no wire.
"""
