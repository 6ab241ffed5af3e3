"""The adapter: everything that touches a wire, a clock, a disk or a person.

The numeric cores are packages of their own; nothing here estimates or controls.
"""
