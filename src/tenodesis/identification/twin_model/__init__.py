"""An instrument's twin as the model of its recordings.

From a recording to residuals, a file each:

- `steps`: motion of handle and spools reconstructed from quantised encoders, averaged over time steps with readings
- `marginalise`: residuals with the errors left in these inputs marginalised out
- `stepped`: what all models by a twin have in common, those of routings (`..routing`) too
- `problem`: the parameters, and all of it as a `Problem` with exact derivatives
- `formats`: the recordings that it is fitted to
- `tuning`: every number that was chosen by trial rather than derived
"""
