"""Several encoders on one port, all in data exchange at once."""

from peer import Master, arguments, fact, main


def script(options):
    master = Master(options)
    for address in options.addresses:
        # One after the other: the library gives a short acknowledgement to every slave that waits for one.
        slave = master.add(address)
        master.exchange(1, [slave], report=False)
        fact("started", address=address)
    master.exchange(options.cycles)
    fact("connected", addresses=[slave.slaveAddr for slave in master.dp.getSlaveList() if slave.isConnected()])
    master.close()


if __name__ == "__main__":
    parser = arguments(__doc__)
    parser.add_argument("--addresses", type=lambda text: [int(part) for part in text.split(",")], default=[11, 12, 13])
    main(script, parser.parse_args())
