"""Serve the simulated bench of an instrument file on its CAN bus until interrupted: python -m ... FILE."""

import sys
import time
from typing import Any

import can

from tenodesis import instrument
from tenodesis.errors import InstrumentError

from .bench import SimulatedBench

_LOOK = 0.01  # s


def main(source: str) -> None:
    """Print each change of state of the drives on a line, with the present speeds (rad/s)."""
    inst = instrument.as_instrument(source)
    settings = inst.devices.canopen
    if settings is None or settings.interface == "virtual":
        raise InstrumentError(f"{source}: devices.canopen must be there, with a bus that other processes reach.")
    options: dict[str, Any] = dict(settings.options)
    bus = can.Bus(interface=settings.interface, channel=settings.channel, **options)
    try:
        with SimulatedBench(inst, settings, bus) as bench:
            print(f"serving {inst.name} on {settings.interface} {settings.channel}", flush=True)
            printed = dict.fromkeys(bench.drives, 0)
            while bench.running:
                for node, drive in bench.drives.items():
                    for line in drive.log[printed[node] :]:
                        speeds = " ".join(f"{speed + 0.0:.4g}" for speed in bench.velocity.ravel())
                        print(f"node {node}: {line} (sync {bench.syncs}, speeds {speeds})", flush=True)
                    printed[node] = len(drive.log)
                time.sleep(_LOOK)
    except KeyboardInterrupt:
        pass
    finally:
        bus.shutdown()


if __name__ == "__main__":
    main(sys.argv[1])
