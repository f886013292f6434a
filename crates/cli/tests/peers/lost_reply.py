"""Loses replies in data exchange: the master asks again with the same frame count bit, and the exchange goes on."""

from peer import Failure, Master, arguments, diagnoses, fact, hex_of, main


def script(options):
    master = Master(options)
    slave = master.add(options.address)
    master.exchange(options.cycles)
    phy = master.phy
    start_ups = len(diagnoses(phy))
    for _ in range(options.losses):
        sent = len(phy.sent)
        lost, phy.lose_next = len(phy.lost), 1
        while len(phy.lost) == lost:
            master.step()
        answered = len(phy.received)
        while len(phy.received) == answered:
            master.step()
        requests = phy.sent[sent:]
        fact(
            "lost",
            reply=hex_of(phy.lost[-1]),
            requests=[hex_of(request) for request in requests[-2:]],
            answer=hex_of(phy.received[answered]),
        )
        master.exchange(options.cycles)
    if not slave.isConnected():
        raise Failure("the slave is no longer in data exchange")
    fact("went_on", new_start_ups=len(diagnoses(phy)) - start_ups, refusals=master.refusals)
    master.close()


if __name__ == "__main__":
    parser = arguments(__doc__)
    parser.add_argument("--losses", type=int, default=3)
    main(script, parser.parse_args())
