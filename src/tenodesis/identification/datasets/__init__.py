"""Three public data sets, one file each: how its recordings are read, and the model that is fitted to them.

Each is a plug-in: the engine finds them by their entry points alone (`tenodesis.identification.registry`), and a format
of another package is made like them. `reference` has what their models are written in.
"""
