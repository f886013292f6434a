"""Exchanges data with the library's own master for some seconds; writes down how often, and whatever went wrong."""

import time

from peer import Failure, Master, arguments, diagnoses, fact, main


def script(options):
    master = Master(options)
    master.add(options.address)
    try:
        # The start-up is not part of it.
        master.exchange(1, report=False)
        exchanges = 0
        until = time.monotonic() + options.seconds
        newest = time.monotonic()
        while time.monotonic() < until:
            _, inputs = master.step()
            if inputs is not None:
                exchanges += 1
                newest = time.monotonic()
            elif time.monotonic() - newest > 2.0:
                raise Failure("no inputs for 2 s")
        fact("exchanges", count=exchanges)
    finally:
        fact("diagnoses", octets=diagnoses(master.phy)[-10:], refusals=master.refusals)
    master.close()


if __name__ == "__main__":
    parser = arguments(__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    main(script, parser.parse_args())
