"""The live instrument: a loop in a process of its own, and the clients that watch and command it."""
