"""Reads one of our GSD files with pyprofibus's own reader and prints, for each module, the octets that a master
would send: parameters from octet 8 on, identifiers."""

import contextlib
import io
import json
import sys

from pyprofibus.gsd.interp import GsdInterp

# What the reader of pyprofibus 1.13 does not know and leaves out, by its own words; the standard has all of it.
UNKNOWN = ("FMS_supp", "DP_Encoder_", "Unit_Diag_Bit(", "Bit(", "Unsigned")

said = io.StringIO()
with contextlib.redirect_stdout(said):
    gsd = GsdInterp.fromFile(sys.argv[1], debug=True)
lines = said.getvalue().splitlines()
unknown = [line for line, after in zip(lines, lines[1:]) if after == " --> Ignored unknown line"]

print(json.dumps({
    "ident": gsd.getIdentNumber(),
    "unknown": [line for line in unknown if not line.startswith(UNKNOWN)],
    "faults": sum("warning in" in line for line in lines) - len(unknown),
    "max_tsdr": [gsd.getMaxTSDR(rate) for rate in (9600, 19200, 45450, 93750, 187500, 500000,
                                                   1500000, 3000000, 6000000, 12000000)],
}))
for module in gsd.getField("Module"):
    gsd.clearConfiguredModules()
    gsd.setConfiguredModule(module.name)
    identifiers = b"".join(bytes(element.getDU()) for element in gsd.getCfgDataElements())
    print(json.dumps({
        "module": module.name,
        "parameters": gsd.getUserPrmData().hex().upper(),
        "identifiers": identifiers.hex().upper(),
    }))
