"""Sends Data_Exchange requests twice with the same frame count bit: the second answer comes from memory."""

import time

from peer import Telegrams, arguments, fact, hex_of, main


def script(options):
    telegrams = Telegrams(options)
    telegrams.start_up()
    outputs = None if options.functionality == "class1" else options.outputs
    for _ in range(options.cycles):
        first = telegrams.ask(telegrams.data_exchange(outputs), toggle=False)
        request = telegrams.phy.sent[-1]
        # Long enough for the shaft to have moved on.
        time.sleep(options.pause)
        second = telegrams.ask(telegrams.data_exchange(outputs))
        fact(
            "retry",
            same_request=request == telegrams.phy.sent[-1],
            request=hex_of(request),
            first=hex_of(first),
            second=hex_of(second),
        )
    telegrams.close()


if __name__ == "__main__":
    parser = arguments(__doc__)
    parser.add_argument("--pause", type=float, default=0.02, help="seconds between a request and its retry")
    main(script, parser.parse_args())
