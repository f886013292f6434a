"""Starts data exchange with a watchdog, says nothing for longer than it allows, and comes back."""

import time

from peer import Master, arguments, diagnoses, fact, main


def script(options):
    master = Master(options)
    master.add(options.address, watchdog=options.watchdog)
    master.exchange(options.cycles)
    fact("before", diagnoses=diagnoses(master.phy), refusals=master.refusals)
    for _ in range(options.stalls):
        count, refusals = len(diagnoses(master.phy)), master.refusals
        time.sleep(options.stall)
        begun = time.monotonic()
        # RS, or the library's own patience, sends it back to the start of its state machine.
        master.exchange(1, report=False)
        fact(
            "back",
            after=time.monotonic() - begun,
            diagnoses=diagnoses(master.phy)[count:],
            refusals=master.refusals - refusals,
        )
        master.exchange(options.cycles)
    master.close()


if __name__ == "__main__":
    parser = arguments(__doc__)
    parser.add_argument("--watchdog", type=int, default=100, help="milliseconds")
    parser.add_argument("--stall", type=float, default=0.3, help="seconds")
    parser.add_argument("--stalls", type=int, default=2)
    main(script, parser.parse_args())
