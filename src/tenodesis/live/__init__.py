"""The live instrument: a loop in a process of its own, and those who watch and command it."""
