"""Whatever finds candidates: processes for a stem, valves for a window.

What is found is judged elsewhere: nothing here compares healthy with sticky.
"""
