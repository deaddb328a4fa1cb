"""The verbs of Steersman: what the command line does, as functions.

Each takes the words that its command takes: names of components, of files and of presets, and
assignments ``key.field=value``; and beside them keyword arguments, components and mappings.
"""
