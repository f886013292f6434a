"""Comes to data exchange with the library's own master, and reads inputs; `--runs 2` does it twice in a row,
closing and opening the port within a millisecond."""

from peer import Master, arguments, diagnoses, fact, main


def script(options):
    for run in range(options.runs):
        master = Master(options)
        fact("opened", run=run)
        master.add(options.address)
        try:
            master.exchange(options.cycles)
        finally:
            # In a failure they tell what the slave did not like.
            fact("diagnoses", octets=diagnoses(master.phy)[-10:], refusals=master.refusals)
        master.close()


if __name__ == "__main__":
    parser = arguments(__doc__)
    parser.add_argument("--runs", type=int, default=1)
    main(script, parser.parse_args())
