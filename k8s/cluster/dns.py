"""The names of a test cluster: SERVICE.NAMESPACE.svc.cluster.local from the API server's Services, and nothing else.

python3 dns.py ADDRESS TOKEN        Debian has no CoreDNS. Standard library only.
"""

import json
import socket
import ssl
import struct
import sys
import threading
import time
import urllib.request
from typing import Any

DOMAIN = "svc.cluster.local"
ANSWERED, NO_SUCH_NAME = 0x8580, 0x8583
A = 1


class Names:
    """Addresses by name, as the API server has them; a headless Service has those of its pods, ready or not."""

    def __init__(self, token: str) -> None:
        self._headers = {"Authorization": f"Bearer {token}"}
        self._context = ssl._create_unverified_context()
        self.addresses: dict[str, list[str]] = {}

    def follow(self) -> None:
        """Ask again every second, for good."""
        while True:
            try:
                self.addresses = self._ask()
            except OSError as error:
                print(error, flush=True)
            time.sleep(1)

    def _get(self, path: str) -> list[dict[str, Any]]:
        request = urllib.request.Request(f"https://127.0.0.1:6443{path}", headers=self._headers)
        with urllib.request.urlopen(request, context=self._context, timeout=5) as answer:
            return json.load(answer)["items"]

    def _ask(self) -> dict[str, list[str]]:
        pods = {_name(each): _addresses(each) for each in self._get("/api/v1/endpoints")}
        services = ((_name(each), each["spec"].get("clusterIP")) for each in self._get("/api/v1/services"))
        return {name: pods.get(name, []) if own == "None" else [own] for name, own in services}


def _name(manifest: dict[str, Any]) -> str:
    return f"{manifest['metadata']['name']}.{manifest['metadata']['namespace']}.{DOMAIN}"


def _addresses(endpoints: dict[str, Any]) -> list[str]:
    subsets = endpoints.get("subsets") or []
    lists = (each.get(state) or [] for each in subsets for state in ("addresses", "notReadyAddresses"))
    return [one["ip"] for each in lists for one in each]


def answer(query: bytes, addresses: dict[str, list[str]]) -> bytes:
    """Return the answer to a query with one question."""
    labels, at = [], 12
    while query[at]:
        labels.append(query[at + 1 : at + 1 + query[at]].decode().lower())
        at += 1 + query[at]
    (kind,) = struct.unpack(">H", query[at + 1 : at + 3])
    found = addresses.get(".".join(labels))
    own = found if found and kind == A else []
    head = struct.pack(">HHHHH", NO_SUCH_NAME if found is None else ANSWERED, 1, len(own), 0, 0)
    records = (b"\xc0\x0c" + struct.pack(">HHIH", A, 1, 5, 4) + socket.inet_aton(each) for each in own)
    return query[:2] + head + query[12 : at + 5] + b"".join(records)


def main() -> None:
    address, token = sys.argv[1:]
    names = Names(token)
    threading.Thread(target=names.follow, daemon=True).start()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind((address, 53))
        while True:
            query, asker = server.recvfrom(512)
            server.sendto(answer(query, names.addresses), asker)


if __name__ == "__main__":
    main()
