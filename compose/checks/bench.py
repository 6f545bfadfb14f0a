"""Virtual sensors against the drivers that look for them: a driver whose device nobody plays waits for ever."""

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from compose_yaml import near
from study_file import Service, Study

from checks.finding import Finding, Places

if TYPE_CHECKING:
    from sensor_bench.device import DeviceKeys

ALIKE = 0.85  # from which an address is taken for a wrong spelling of a service's name
ADDRESSES = ("address", "mac_address")
OUTLET = re.compile(r"(?:name|source_id)='([^']*)'")


def findings(study: Study, places: Places) -> Iterator[Finding]:
    """Yield drivers beside the sensor-bench whose virtual device it does not play."""
    bench = study.of("sensor_bench")
    if bench is None:
        return
    from sensor_bench.config import BenchConfig, parse  # loads a Bluetooth stack, which takes most of a second

    try:
        devices = parse(str(bench.parameters.get("devices", BenchConfig.devices))).devices
    except ValueError:  # told as a parameter
        return
    yield from _nobodys(study, bench, devices, places)
    shared = {target: volume for target, volume in bench.mounts.items() if not volume.startswith("/")}
    for sensor in study.sensors:
        yield from _network(study, sensor, bench, devices, places)
        if set(shared.values()) & set(sensor.mounts.values()):
            yield from _socket(sensor, bench, devices, places)
            yield from _radio(sensor, bench, devices, places)


def _nobodys(study: Study, bench: Service, devices: "tuple[DeviceKeys, ...]", places: Places) -> Iterator[Finding]:
    """Yield virtual devices that go by a name which is nearly a sensor's, but none's."""
    sensors = [sensor.sensor_id for sensor in study.sensors]
    for device in devices:
        if device.sensor not in sensors and (meant := near(device.sensor, sensors, ALIKE)):
            yield places.warning(
                f"services.{bench.name}", f"sensor {device.sensor!r} is no sensor{meant}", device.sensor
            )


def _socket(sensor: Service, bench: Service, devices: "tuple[DeviceKeys, ...]", places: Places) -> Iterator[Finding]:
    """Yield a driver's port in the shared volume that is no device's."""
    made = [str(device.at) for device in devices if hasattr(device, "at")]
    port = str(sensor.parameters.get("port", ""))
    if port.startswith(tuple(f"{target}/" for target in bench.mounts)) and port not in made:
        text = f"port {port!r} is made by no device of {bench.name}{near(port, made)}"
        yield places.warning(f"services.{sensor.name}.command", text, "port:=")


def _network(
    study: Study, sensor: Service, bench: Service, devices: "tuple[DeviceKeys, ...]", places: Places
) -> Iterator[Finding]:
    """Yield a service's name that is misspelt, a port that no device has, and a session of LSL that none is in."""
    keys, given = f"services.{sensor.name}.command", sensor.parameters
    services = [service.name for service in study.services]
    peers = given.get("known_peers", [])
    for parameter, name in [("address", given.get("address")), *(("known_peers", each) for each in _list(peers))]:
        if name and name not in services and (meant := near(str(name), services, ALIKE)):
            yield places.warning(keys, f"{parameter} {name!r} is no service of the study{meant}", f"{parameter}:=")
    ports = {getattr(device, "port", None) for device in devices}
    if given.get("address") == bench.name and "port" in given and given["port"] not in ports:
        yield places.warning(keys, f"port {given['port']} is that of no device of {bench.name}", "port:=")
    sessions = {str(device.session) for device in devices if hasattr(device, "session")}
    session = given.get("session")
    if bench.name not in _list(peers):
        return
    if session and str(session) not in sessions:
        text = f"session {session!r} is that of no device of {bench.name}{near(str(session), sessions)}"
        yield places.warning(keys, text, "session:=")
    senders = [device for device in devices if hasattr(device, "session")]
    played = {outlet for device in senders for outlet in _outlets(device)}
    own = tuple(f"{device.name} " for device in senders if hasattr(device, "emulator"))  # its file says how they end
    for outlet in OUTLET.findall(" ".join(_list(given.get("outlets")))):
        if outlet not in played and not outlet.startswith(own):
            text = f"outlet {outlet!r} is that of no device of {bench.name}{near(outlet, played)}"
            yield places.warning(keys, text, "outlets:=")


def _outlets(device: Any) -> Iterator[str]:
    """Yield the names and source ids that a sender's outlets can have."""
    source_id = getattr(device, "source_id", "") or f"bench-{device.sensor}"
    for outlet in (device.name or device.sensor, source_id):
        yield from (outlet, f"{outlet} Markers", f"{outlet}-markers")


def _list(given: Any) -> list[str]:
    return list(map(str, given)) if isinstance(given, list | tuple) else []


def _radio(sensor: Service, bench: Service, devices: "tuple[DeviceKeys, ...]", places: Places) -> Iterator[Finding]:
    """Yield a driver's name or address that no virtual Bluetooth device has."""
    played = [device for device in devices if hasattr(device, "address") and not hasattr(device, "port")]
    known = {str(getattr(device, "address", "")).lower() for device in played}
    for parameter in ADDRESSES:
        address = str(sensor.parameters.get(parameter, ""))
        if address.count(":") == 5 and address.lower() not in known:
            text = f"{parameter} {address!r} is that of no device of {bench.name}{near(address.lower(), known)}"
            yield places.warning(f"services.{sensor.name}.command", text, f"{parameter}:=")
    name = str(sensor.parameters.get("name", ""))
    if name and not any(_called(device, name) for device in played):
        text = f"name {name!r} is that of no device of {bench.name}"
        yield places.warning(f"services.{sensor.name}.command", text, "name:=")


def _called(device: Any, name: str) -> bool:
    """Return whether a device advertises this name, or its id is the name or ends it."""
    own = [str(getattr(device, key, "") or "") for key in ("name", "device_id")]
    return any(text and name.lower().endswith(text.lower()) for text in own)
