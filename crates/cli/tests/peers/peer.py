"""What the scripts of this directory share: pyprofibus 1.13 as a master that writes down what it sees.

Each script drives one `sch108bex run` over its port and prints facts, one JSON object a line, octets as
upper case hex. Whoever starts it judges the facts: the scripts know nothing of the shaft. Exit status 0:
the script saw what it set out to see; 1: it did not, and the last fact says why.
"""

import argparse
import json
import os
import signal
import sys
import time

# The library prints where the facts go. It prints into the log instead.
FACTS = os.fdopen(os.dup(1), "w", buffering=1)
sys.stdout = sys.stderr

import pyprofibus.dp_master as dp_master  # noqa: E402
from pyprofibus.dp import (  # noqa: E402
    DpCfgDataElement,
    DpError,
    DpTelegram_DataExchange_Req,
    DpTelegram_SetPrm_Req,
    DpTelegram_ChkCfg_Req,
    DpTelegram_SlaveDiag_Req,
    DpTransceiver,
)
from pyprofibus.fdl import (  # noqa: E402
    FdlFCB,
    FdlTelegram,
    FdlTelegram_FdlStat_Req,
    FdlTelegram_stat0,
    FdlTransceiver,
)
from pyprofibus.phy_serial import CpPhySerial  # noqa: E402
from pyprofibus.util import ProfibusError  # noqa: E402

MASTER = 2

# The functionalities of the encoder: parameters from octet 9 on, the manual's defaults for 16 and 15 bits (no
# scaling, time base 100 ms); configuration; octets out and in.
FUNCTIONALITIES = {
    "class1": ("00", "D1", 0, 4),
    "class2": ("02" + "00010000" + "80000000" + 8 * "00", "F1", 4, 4),
    "scancon": ("02" + "00010000" + "80000000" + 8 * "00" + "01", "F1D1D1", 4, 12),
}


class Failure(Exception):
    """The script did not see what it set out to see."""


def fact(kind, **fields):
    """Prints one fact."""
    FACTS.write(json.dumps({"fact": kind, **fields}) + "\n")


def hex_of(octets):
    return bytes(octets).hex().upper()


def arguments(description):
    """The arguments that all scripts have; a script may add its own before it parses them."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("port", help="what `sch108bex run` has printed after `bus:`")
    parser.add_argument("--baud", type=int, default=19200)
    parser.add_argument("--address", type=int, default=11)
    parser.add_argument("--ident", type=lambda text: int(text, 16), default=0x108B, help="hex")
    parser.add_argument("--functionality", choices=FUNCTIONALITIES, default="class2")
    parser.add_argument("--parameters", help="parameters from octet 9 on, as hex, instead of the defaults")
    parser.add_argument("--outputs", default="00000000", help="what the master sends, as hex")
    parser.add_argument("--cycles", type=int, default=20, help="how many exchanges to see")
    parser.add_argument("--timeout", type=float, default=20.0, help="seconds for the whole script")
    return parser


def main(script, options):
    """Runs `script(options)` within its time, and exits with its status."""

    def too_late(*_):
        raise Failure("not done in {} s".format(options.timeout))

    signal.signal(signal.SIGALRM, too_late)
    signal.setitimer(signal.ITIMER_REAL, options.timeout)
    try:
        script(options)
    except (Failure, ProfibusError, OSError) as error:
        fact("failed", why="{}: {}".format(type(error).__name__, error))
        sys.exit(1)
    fact("done")


class Phy(CpPhySerial):
    """The library's serial port, which writes down telegrams and can lose replies."""

    def __init__(self, port, baud):
        super().__init__(port=port)
        self.sent = []
        self.received = []
        self.lost = []
        self.lose_next = 0
        self.setConfig(baudrate=baud)

    def sendData(self, telegramData, srd):
        self.sent.append(bytes(telegramData))
        super().sendData(telegramData, srd)

    def pollData(self, timeout=0.0):
        telegram = super().pollData(timeout)
        if telegram is None:
            return None
        if self.lose_next > 0:
            self.lose_next -= 1
            self.lost.append(bytes(telegram))
            return None
        self.received.append(bytes(telegram))
        return telegram


def user_parameters(options):
    """User_Prm_Data: octet 8 belongs to the slave's ASIC, octet 9 and up to the encoder."""
    text = options.parameters or FUNCTIONALITIES[options.functionality][0]
    return bytes.fromhex("00" + text)


def configuration(options):
    octets = bytes.fromhex(FUNCTIONALITIES[options.functionality][1])
    return [DpCfgDataElement(identifier=octet) for octet in octets]


def diagnoses(phy):
    """The standard parts of all diagnoses received: a response from SAP 60 to SAP 62."""
    found = []
    for telegram in phy.received:
        unit = telegram[7:-2] if telegram[0] == FdlTelegram.SD2 else telegram[4:-2]
        if len(unit) >= 8 and unit[0] == 62 and unit[1] == 60:
            found.append(hex_of(unit[2:8]))
    return found


class Master:
    """The library's class 1 master with its own state machine, for slaves with outputs."""

    def __init__(self, options):
        self.options = options
        self.phy = Phy(options.port, options.baud)
        self.dp = dp_master.DPM1(phy=self.phy, masterAddr=MASTER)
        self.dp.initialize()
        self.refusals = 0

    def add(self, address, watchdog=0):
        """A slave by its address; no GSD file is needed."""
        options = self.options
        _, _, outputs, inputs = FUNCTIONALITIES[options.functionality]
        slave = dp_master.DpSlaveDesc()
        slave.slaveAddr = address
        slave.identNumber = options.ident
        slave.name = "encoder {}".format(address)
        # The library calls input what the slave takes in.
        slave.inputSize, slave.outputSize = outputs, inputs
        slave.setPrmTelegram.da = slave.chkCfgTelegram.da = address
        slave.setPrmTelegram.identNumber = options.ident
        slave.setUserPrmData(user_parameters(options))
        slave.setCfgDataElements(configuration(options))
        slave.setWatchdog(watchdog)
        self.dp.addSlave(slave)
        return slave

    def step(self):
        """One step of the state machine; the slave whose turn it was, and its inputs if there are any."""
        for slave in self.dp.getSlaveList():
            slave.setMasterOutData(bytes.fromhex(self.options.outputs))
        try:
            slave = self.dp.run()
        except DpError as error:
            # RS to a Data_Exchange: the library leaves it to its user.
            if "Service not active" not in str(error):
                raise
            self.refusals += 1
            return None, None
        inputs = slave.getMasterInData() if slave else None
        if inputs is None:
            # Somebody else may need the processor.
            time.sleep(0.0001)
        return slave, inputs

    def exchange(self, cycles, slaves=None, report=True):
        """Goes on until each of `slaves` (None: all) has given its inputs `cycles` times."""
        wanted = {slave.slaveAddr: cycles for slave in slaves or self.dp.getSlaveList()}
        while any(left > 0 for left in wanted.values()):
            slave, inputs = self.step()
            if inputs is None or wanted.get(slave.slaveAddr, 0) <= 0:
                continue
            wanted[slave.slaveAddr] -= 1
            if report:
                fact("inputs", address=slave.slaveAddr, octets=hex_of(inputs), at=time.monotonic())

    def close(self):
        self.dp.destroy()


class Telegrams:
    """The library's telegram layer, request by request, with the frame count bit of one slave."""

    def __init__(self, options):
        self.options = options
        self.phy = Phy(options.port, options.baud)
        self.fdl = FdlTransceiver(self.phy)
        self.fdl.setRXFilter([MASTER])
        self.dp = DpTransceiver(self.fdl, thisIsMaster=True)
        self.fcb = FdlFCB(enable=False)

    def ask(self, telegram, expect=True, toggle=True, patience=0.5):
        """Sends a request and gives the octets of its answer, None if there is none.

        With `toggle` off the frame count bit stays, so that the next request is a retry of this one.
        """
        self.phy.releaseBus()
        count = len(self.phy.received)
        transceiver = self.fdl if FdlTelegram.checkType(telegram) else self.dp
        transceiver.send(self.fcb, telegram)
        until = time.monotonic() + patience
        while len(self.phy.received) == count and time.monotonic() < until:
            self.dp.poll(0.002)
        if len(self.phy.received) == count:
            if expect:
                raise Failure("no answer to " + hex_of(self.phy.sent[-1]))
            return None
        if toggle:
            self.fcb.handleReply()
        return self.phy.received[-1]

    def status(self):
        """Asks for the FDL status, as often as it takes, without a frame count bit."""
        self.fcb.enableFCB(False)
        answer = None
        while answer is None:
            request = FdlTelegram_FdlStat_Req(da=self.options.address, sa=MASTER)
            answer = self.ask(request, expect=False, toggle=False, patience=1.0)
        self.fcb.resetFCB()
        self.fcb.enableFCB(True)
        return answer

    def diagnosis(self):
        return self.ask(DpTelegram_SlaveDiag_Req(da=self.options.address, sa=MASTER))

    def start_up(self):
        """From the FDL status to a slave that is ready for Data_Exchange."""
        options = self.options
        fact("status", octets=hex_of(self.status()))
        fact("diagnosis", octets=hex_of(self.diagnosis()))
        parameters = DpTelegram_SetPrm_Req(da=options.address, sa=MASTER)
        parameters.identNumber = options.ident
        parameters.addUserPrmData(user_parameters(options))
        fact("set_prm", octets=hex_of(self.ask(parameters)))
        check = DpTelegram_ChkCfg_Req(da=options.address, sa=MASTER)
        for element in configuration(options):
            check.addCfgDataElement(element)
        fact("chk_cfg", octets=hex_of(self.ask(check)))
        fact("diagnosis", octets=hex_of(self.diagnosis()))

    def data_exchange(self, outputs=None):
        """A Data_Exchange request: SD1 where there are no outputs."""
        address = self.options.address
        if outputs:
            return DpTelegram_DataExchange_Req(da=address, sa=MASTER, du=bytes.fromhex(outputs))
        return FdlTelegram_stat0(da=address, sa=MASTER, fc=FdlTelegram.FC_REQ | FdlTelegram.FC_SRD_HI)

    def close(self):
        self.phy.close()
