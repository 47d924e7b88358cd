"""An instrument's twin as the model of its recordings.

From a recording to residuals, a file each:

- `inputs`: the motion of handle and spools, reconstructed from their quantised encoders, with the errors left in it
- `steps`: recording and inputs averaged over the twin's time steps, and how a run begins
- `marginalise`: residuals with those input errors marginalised out
- `unknowns`: the parameters, and where they stand in an instrument file
- `problem`: all of it as a `Problem` with exact derivatives
- `formats`: the recordings that it is fitted to
- `tuning`: every number that was chosen by trial rather than derived
"""
