"""The PMD control point of a device as a state machine: commands in, responses and a change of streams out. No I/O."""

from typing import NamedTuple

from sensor_bench.polar import pmd
from sensor_bench.polar.models import MTU, Model, Offer, Stream
from sensor_bench.polar.pmd import Command, Measurement, Setting, Status

SDK_OFF = (Measurement.PPI,)
"""Measurements that the firmware's algorithms make: they rest while SDK mode is on."""


class Settings(NamedTuple):
    """What a stream was started with; 0 where the measurement has no such setting."""

    rate_hz: int
    range: int


class Answer(NamedTuple):
    """What the device indicates, and which stream it begins or ends."""

    responses: list[bytes]
    started: Stream | None = None
    stopped: Stream | None = None


REFUSALS = {
    Setting.RATE: Status.INVALID_RATE,
    Setting.RESOLUTION: Status.INVALID_RESOLUTION,
    Setting.RANGE: Status.INVALID_RANGE,
    Setting.CHANNELS: Status.INVALID_CHANNELS,
}


class ControlPoint:
    """State of one device: what is streaming, and whether SDK mode is on."""

    def __init__(self, model: Model, page_bytes: int = MTU - pmd.ATT_OVERHEAD - 5) -> None:
        self.model = model
        self._page_bytes = page_bytes
        self.running: dict[Measurement, Settings] = {}
        self.sdk_mode = False

    def link_lost(self) -> None:
        """The firmware ends everything with the link, so that a new connection can start again."""
        self.running.clear()
        self.sdk_mode = False

    def answer(self, command: bytes, mtu: int) -> Answer:
        if mtu < MTU:
            # seen on an H10: four bytes, with the measurement type where the operation should be
            return Answer([bytes([pmd.RESPONSE, 0x00, command[0] if command else 0, Status.INVALID_MTU])])
        if not command:
            return Answer([pmd.response(0, 0, Status.INVALID_LENGTH)])
        operation = command[0]
        if operation in (Command.GET_STATUS, Command.GET_SDK_STATUS):
            return self._status(operation)
        if operation not in list(Command):
            return Answer([pmd.response(operation, command[1] if len(command) > 1 else 0, Status.INVALID_OP)])
        if len(command) < 2:
            return Answer([pmd.response(operation, 0, Status.INVALID_LENGTH)])
        kind = command[1] & 0x3F
        if kind == Measurement.SDK_MODE and self.model.sdk_mode:
            return self._switch_sdk_mode(operation)
        stream = self.model.stream(kind)
        if stream is None or command[1] & 0x80:
            known = kind in list(Measurement)
            refusal = Status.NOT_SUPPORTED if known else Status.INVALID_MEASUREMENT
            return Answer([pmd.response(operation, command[1], refusal)])
        if operation == Command.START:
            return self._start(stream, command[2:])
        if operation == Command.STOP:
            return self._stop(stream)
        return self._settings(operation, stream)

    def _offer(self, stream: Stream) -> Offer:
        return stream.sdk_offer if self.sdk_mode and stream.sdk_offer is not None else stream.offer

    def _settings(self, operation: int, stream: Stream) -> Answer:
        offer = stream.offer
        if operation == Command.GET_SDK_SETTINGS:
            if stream.sdk_offer is None:
                return Answer([pmd.response(operation, stream.measurement, Status.NOT_SUPPORTED)])
            offer = stream.sdk_offer
        return Answer(pmd.paged_responses(operation, stream.measurement, pmd.settings(offer), self._page_bytes))

    def _status(self, operation: int) -> Answer:
        if operation == Command.GET_SDK_STATUS:
            return Answer([pmd.response(operation, 0, Status.SUCCESS, bytes([self.sdk_mode]))])
        online = 0x40
        states = bytes(s.measurement | (online if s.measurement in self.running else 0) for s in self.model.streams)
        return Answer([pmd.response(operation, 0, Status.SUCCESS, states)])

    def _switch_sdk_mode(self, operation: int) -> Answer:
        on = operation == Command.START
        if operation not in (Command.START, Command.STOP):
            status = Status.INVALID_OP
        elif self.running:
            status = Status.INVALID_STATE
        elif on == self.sdk_mode:
            status = Status.ALREADY_IN_STATE
        else:
            status = Status.SUCCESS
            self.sdk_mode = on
        return Answer([pmd.response(operation, Measurement.SDK_MODE, status)])

    def _start(self, stream: Stream, parameters: bytes) -> Answer:
        kind = stream.measurement
        if kind in self.running:
            return Answer([pmd.response(Command.START, kind, Status.ALREADY_IN_STATE)])
        if self.sdk_mode and kind in SDK_OFF:
            return Answer([pmd.response(Command.START, kind, Status.INVALID_STATE)])
        try:
            asked = pmd.parse_settings(parameters)
        except pmd.MalformedCommand:
            return Answer([pmd.response(Command.START, kind, Status.INVALID_LENGTH)])
        if (refusal := self._refusal(asked, self._offer(stream))) is not None:
            return Answer([pmd.response(Command.START, kind, refusal)])
        rate, range_ = asked.get(Setting.RATE, [0])[0], asked.get(Setting.RANGE, [0])[0]
        self.running[kind] = Settings(rate, range_)
        extra = b""
        if stream.factor is not None:
            extra = pmd.settings({Setting.FACTOR: (stream.factor,)})
        elif stream.reserved_byte is not None:
            extra = bytes([stream.reserved_byte])
        return Answer([pmd.response(Command.START, kind, Status.SUCCESS, extra)], started=stream)

    @staticmethod
    def _refusal(asked: dict[Setting, list[int]], offer: Offer) -> Status | None:
        """Every offered setting must be chosen, with one offered value, and nothing else be asked."""
        if set(asked) != set(offer):
            return Status.INVALID_PARAMETER
        for setting, values in asked.items():
            if len(values) != 1 or values[0] not in offer[setting]:
                return REFUSALS.get(setting, Status.INVALID_PARAMETER)
        return None

    def _stop(self, stream: Stream) -> Answer:
        if self.running.pop(stream.measurement, None) is None:
            return Answer([pmd.response(Command.STOP, stream.measurement, Status.ALREADY_IN_STATE)])
        return Answer([pmd.response(Command.STOP, stream.measurement, Status.SUCCESS)], stopped=stream)
