"""Data exchange as `data_exchange.py` does it, over TCP: the port is `socket://ADDRESS:PORT`.

The library opens its port with `serial.Serial`, which takes no URLs; pyserial's class for sockets takes
its place.
"""

import serial
import serial.urlhandler.protocol_socket

serial.Serial = serial.urlhandler.protocol_socket.Serial

from data_exchange import script  # noqa: E402
from peer import arguments, main  # noqa: E402

if __name__ == "__main__":
    parser = arguments(__doc__)
    parser.add_argument("--runs", type=int, default=1)
    main(script, parser.parse_args())
