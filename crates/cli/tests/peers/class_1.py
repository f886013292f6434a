"""Class 1, which has no outputs and which the library's master therefore refuses: start-up and diagnosis by its
DP layer, cyclic SD1 requests by its telegram layer."""

import time

from peer import Failure, Telegrams, arguments, fact, hex_of, main


def script(options):
    telegrams = Telegrams(options)
    telegrams.start_up()
    for _ in range(options.cycles):
        answer = telegrams.ask(telegrams.data_exchange())
        # SD2 with LE 7: DA, SA, FC and four inputs.
        if len(answer) != 13 or telegrams.phy.sent[-1][0] != 0x10:
            raise Failure("unexpected answer " + hex_of(answer))
        fact("inputs", address=options.address, octets=hex_of(answer[7:11]), at=time.monotonic())
    telegrams.close()


if __name__ == "__main__":
    parser = arguments(__doc__)
    parser.set_defaults(functionality="class1")
    main(script, parser.parse_args())
