"""Parameters of driver-brainflow, and what it declares of its streams."""

from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from sense4hri.device import MESSAGE_S, DriverConfig, Stream
from sense4hri.schema import parameter

from driver_brainflow.protocol import BY_COMMAND, EXG, TYPES, Source, sources
from driver_brainflow.rows import DEVICES
from driver_brainflow.transport import PLAYBACK, STREAMING, SUFFIX, boards, description

__all__ = ["DEVICES", "BrainflowConfig", "sources_of", "streams_of"]
SAME = (  # parameters that BrainFlow knows by the same name
    *(f"{name}{which}" for name in ("ip_address", "ip_port", "file") for which in ("", "_aux", "_anc")),
    *("serial_port", "mac_address", "serial_number", "other_info"),
)
IP_PROTOCOLS = ("none", "udp", "tcp")


@dataclass(frozen=True, kw_only=True)
class BrainflowConfig(DriverConfig):
    """Which board, how it is reached, and what of it."""

    board: str = parameter(
        help="BrainFlow's name of it, without `_BOARD`: CYTON, GANGLION_NATIVE, MUSE_2, EMOTIBIT, UNICORN, ...",
        example="SYNTHETIC",
    )
    serial_port: str = parameter("", help="of boards on a serial port or dongle", example="/dev/ttyUSB0")
    mac_address: str = parameter("", help="of Bluetooth boards; empty = the first one found")
    ip_address: str = parameter("", help="of boards on the network")
    ip_address_aux: str = parameter("", help="the same of the auxiliary preset")
    ip_address_anc: str = parameter("", help="the same of the ancillary preset")
    ip_port: int = parameter(0, help="of boards on the network; 0 = BrainFlow's own", low=0, high=65535)
    ip_port_aux: int = parameter(0, help="the same of the auxiliary preset", low=0, high=65535)
    ip_port_anc: int = parameter(0, help="the same of the ancillary preset", low=0, high=65535)
    ip_protocol: str = parameter("none", help="of boards that know both", choices=IP_PROTOCOLS)
    timeout_s: int = parameter(
        0, help="for discovery and connection; 0 = BrainFlow's own, which is 4 to 20 s", unit="s", low=0, high=60
    )
    other_info: str = parameter("", help="what BrainFlow's page of the board calls so")
    file: str = parameter("", help="of PLAYBACK_FILE: what BrainFlow's streamer wrote of the default preset")
    file_aux: str = parameter("", help="the same of the auxiliary preset")
    file_anc: str = parameter("", help="the same of the ancillary preset")
    master_board: str = parameter("", help="of PLAYBACK_FILE and STREAMING: the board whose samples these are")
    recorded_times: bool = parameter(
        True, help="PLAYBACK_FILE: the recording's stamps are device times; false = it is played as if live"
    )
    commands: tuple[str, ...] = parameter(
        (), help="sent to the board before it starts (`config_board`): gains, presets, loopback_true"
    )
    streams: tuple[str, ...] = parameter(
        (), help="sensor types; empty = all of the contract that the board sends unasked", choices=TYPES
    )
    exg: tuple[str, ...] = parameter(
        (),
        help="what the electrodes measure: one for all, or one each in the board's order; empty = what BrainFlow says",
        choices=(*EXG, "off"),
    )
    poll_s: float = parameter(MESSAGE_S, help="how often BrainFlow is asked for samples", unit="s", low=0.005, high=1)
    verbose: bool = parameter(False, help="BrainFlow's own log, on stderr")

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_board("board", self.board)
        if (self.board in (PLAYBACK, STREAMING)) != bool(self.master_board):
            raise ValueError(f"master_board: to be given with {PLAYBACK} and {STREAMING}, and with no other board")
        if self.master_board:
            _check_board("master_board", self.master_board)
        if self.board == PLAYBACK and not (self.file or self.file_aux or self.file_anc):
            raise ValueError(f"file: {PLAYBACK} plays one, give it, file_aux or file_anc")

    @property
    def asks_rates(self) -> bool:
        """True: its memory or a command may have set another rate than that of BrainFlow's table."""
        return True

    @property
    def described(self) -> str:
        """The board whose samples come."""
        return self.master_board or self.board

    @property
    def recorded(self) -> bool:
        """True where the samples have a recording's own times."""
        return self.board == PLAYBACK and self.recorded_times

    @property
    def presets(self) -> tuple[str, ...]:
        """Those that come: of a playback the ones that have a file."""
        files = {"default": self.file, "auxiliary": self.file_aux, "ancillary": self.file_anc}
        there = tuple(description(self.described))
        return tuple(name for name in there if files[name]) if self.board == PLAYBACK else there

    @property
    def inputs(self) -> dict[str, Any]:
        """What BrainFlow is given, by its own names."""
        given = {name: getattr(self, name) for name in SAME}
        given |= {"timeout": self.timeout_s, "ip_protocol": IP_PROTOCOLS.index(self.ip_protocol)}
        return given | ({"master_board": boards()[self.master_board]} if self.master_board else {})

    @property
    def all_commands(self) -> tuple[str, ...]:
        """What is sent to the board: the study's commands, what its streams need, how a file is played."""
        needed = [command for each, command in BY_COMMAND.get(self.board, {}).items() if each in self.streams]
        played = ["old_timestamps" if self.recorded_times else "new_timestamps"] if self.board == PLAYBACK else []
        return (*played, *needed, *self.commands)


def _check_board(name: str, board: str) -> None:
    known = [each for each in boards() if name == "board" or each not in (PLAYBACK, STREAMING)]
    if board not in known:
        near = get_close_matches(board.upper().removesuffix(SUFFIX), known, 4, 0.4)
        raise ValueError(f"{name} {board!r}: BrainFlow has no such board; near it: {', '.join(near) or 'none'}")


def sources_of(config: BrainflowConfig) -> dict[str, Source]:
    """Return where each stream of the board comes from. Raises ConfigError that names the parameter."""
    table = description(config.described)
    return sources(config.described, {name: table[name] for name in config.presets}, config.streams, config.exg)


def streams_of(config: BrainflowConfig) -> dict[str, Stream]:
    """Return what the driver declares of each raw stream, by BrainFlow's own tables."""
    return {sensor_type: source.stream for sensor_type, source in sources_of(config).items()}
