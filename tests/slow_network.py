"""Several hosts on one machine: network namespaces whose only link is this process, which delays, loses and cuts.

Every namespace has one TUN device. What it sends is read here and written to the device of whom it is meant for, so
no `netem` is needed; multicast goes nowhere. Root, `ip` and /dev/net/tun are: `why_not` says what is missing.
"""

import ctypes
import fcntl
import heapq
import itertools
import os
import random
import select
import shutil
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
CLONE_NEWNET = 0x40000000
DEVICE = "hosts0"
LIBC = ctypes.CDLL(None, use_errno=True)
Found = TypeVar("Found")


def why_not() -> str:
    """Return why no network of namespaces can be made here; empty where one can."""
    if os.geteuid() != 0 or shutil.which("ip") is None:
        return "needs root and the command ip"
    if not Path("/dev/net/tun").exists():
        return "needs /dev/net/tun"
    name = f"why-not-{os.getpid()}"
    made = subprocess.run(["ip", "netns", "add", name], capture_output=True, text=True, check=False)
    if made.returncode:
        return f"no network namespace can be made: {made.stderr.strip()}"
    try:
        os.close(within(name, _device))
    except OSError as err:
        return f"no TUN device can be made: {err}"
    finally:
        subprocess.run(["ip", "netns", "del", name], check=False)
    return ""


class SlowNetwork:
    """Hosts by name. delay_s, loss: of every packet from now on; `cut` and `heal` part one host from all others.

    address: of each, where the hosts have some already.
    """

    def __init__(self, *hosts: str, seed: int = 1, address: Mapping[str, str] | None = None) -> None:
        self.delay_s, self.loss = 0.0, 0.0
        self.carried = self.dropped = 0
        self._random = random.Random(seed)
        self._cut: set[str] = set()
        self._names = {host: f"{host}-{os.getpid()}" for host in hosts}
        self.address = dict(address or {host: f"10.77.0.{number}" for number, host in enumerate(hosts, 1)})
        self._by_address = {bytes(map(int, address.split("."))): host for host, address in self.address.items()}
        self._fds = {host: self._make(host) for host in hosts}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._carry, name="network", daemon=True)
        self._thread.start()

    def inside(self, host: str) -> list[str]:
        """Return the words before a command that is to run on a host."""
        return ["ip", "netns", "exec", self._names[host]]

    def within(self, host: str, do: Callable[[], Found]) -> Found:
        """Return what a function returns that is called on a host."""
        return within(self._names[host], do)

    def peers(self, host: str) -> str:
        """Return ROS_STATIC_PEERS of a host: all others."""
        return ";".join(address for other, address in self.address.items() if other != host)

    def cut(self, host: str) -> None:
        """Nothing more comes or goes."""
        self._cut.add(host)

    def heal(self, host: str) -> None:
        """It is connected again."""
        self._cut.discard(host)

    def close(self) -> None:
        """Take everything down."""
        self._ended.set()
        self._thread.join()
        for host, fd in self._fds.items():
            os.close(fd)
            subprocess.run(["ip", "netns", "del", self._names[host]], check=False)

    def _make(self, host: str) -> int:
        name = self._names[host]
        subprocess.run(["ip", "netns", *self._named(host, name)], check=True)
        fd = within(name, _device)
        for words in self._settings(host):
            subprocess.run(["ip", "-n", name, *words], check=True)
        return fd

    def _named(self, host: str, name: str) -> list[str]:
        """Return what `ip netns` does for the namespace of a host to have this name: it makes one."""
        return ["add", name]

    def _settings(self, host: str) -> list[list[str]]:
        """Return what `ip` does on a host that has its device."""
        return [
            ["addr", "add", f"{self.address[host]}/24", "dev", DEVICE],
            ["link", "set", DEVICE, "mtu", "1500", "up"],
            ["link", "set", "lo", "up"],
        ]

    def _carry(self) -> None:
        waiting: list[tuple[float, int, int, bytes]] = []  # when, in which order, to where, what
        numbers, hosts = itertools.count(), {fd: host for host, fd in self._fds.items()}
        while not self._ended.is_set():
            wait_s = min(0.1, max(0.0, waiting[0][0] - time.monotonic())) if waiting else 0.1
            for fd in select.select(list(hosts), [], [], wait_s)[0]:
                packet = os.read(fd, 65536)
                to = self._by_address.get(packet[16:20]) if packet[0] >> 4 == 4 else None
                if to is not None:
                    self._accept(hosts[fd], to, (time.monotonic() + self.delay_s, next(numbers)), packet, waiting)
            while waiting and waiting[0][0] <= time.monotonic():
                _, _, fd, packet = heapq.heappop(waiting)
                os.write(fd, packet)

    def _accept(self, source: str, to: str, due: tuple[float, int], packet: bytes, waiting: list[tuple]) -> None:
        if {source, to} & self._cut or self._random.random() < self.loss:
            self.dropped += 1
            return
        self.carried += 1
        heapq.heappush(waiting, (*due, self._fds[to], packet))


def within(namespace: str, do: Callable[[], Found]) -> Found:
    """Return what a function returns that is called in a network namespace: a thread of its own goes there and ends."""

    def go() -> Found:
        with open(f"/run/netns/{namespace}") as file:
            if LIBC.setns(file.fileno(), CLONE_NEWNET):
                raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
        return do()

    with ThreadPoolExecutor(1) as thread:
        return thread.submit(go).result()


def _device() -> int:
    """Return a TUN device, made here."""
    fd = os.open("/dev/net/tun", os.O_RDWR | os.O_CLOEXEC)
    try:
        fcntl.ioctl(fd, TUNSETIFF, struct.pack("16sH", DEVICE.encode(), IFF_TUN | IFF_NO_PI))
    except OSError:
        os.close(fd)
        raise
    return fd
