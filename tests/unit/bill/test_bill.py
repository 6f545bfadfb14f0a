"""What is shipped: every licence known, no GPL that nobody judged, and bills of materials that others can read."""

import json
import re

import bill
import pytest
import shipped
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

GPL = re.compile(r"GPL|General Public", re.IGNORECASE)


@pytest.fixture(scope="module")
def bills() -> dict[str, str]:
    return {image: bill.sbom(image) for image in shipped.images()}


def test_no_gpl_that_nobody_judged() -> None:
    """Every package of every image says its licence; (A|L)GPL only where licences.toml says why."""
    found = {part.name: part.licence for image in shipped.images() for part in shipped.parts(image)}
    copyleft = {name for name, licence in found.items() if GPL.search(licence)}
    assert copyleft == shipped.SAID["judged"].keys(), {name: found.get(name) for name in copyleft}
    assert len(found) > 100


def test_a_package_that_says_nothing_is_named() -> None:
    """What is not installed and not said, or a Debian package nobody read, is an error that names it."""
    with pytest.raises(LookupError, match="no_such_package is not installed"):
        shipped.licence("no_such_package")
    with pytest.raises(LookupError, match="Debian's readline"):
        shipped._debian(["readline"])


def test_bills_are_valid_and_the_same_again(bills: dict[str, str]) -> None:
    """CycloneDX's own schema takes each; made again it is the same; versions are pinned; nothing twice."""
    validator = JsonStrictValidator(SchemaVersion.V1_6)
    for image, text in bills.items():
        assert validator.validate_str(text) is None, image
        components = json.loads(text)["components"]
        assert all(part.get("version") for part in components if part.get("purl", "").startswith("pkg:pypi"))
        assert len({part["bom-ref"] for part in components}) == len(components)
    assert bill.sbom("web-gui") == bills["web-gui"]


def test_a_bill_has_what_the_image_is_built_of(bills: dict[str, str]) -> None:
    """What the base has, what a service adds with all that it requires, Debian's packages; nothing of tests."""
    names = {image: {part["name"] for part in json.loads(text)["components"]} for image, text in bills.items()}
    assert {"sense4hri", "ros-rclpy", "numpy", "prometheus-client", "python3", "debian"} <= names["base"]
    assert names["base"] < names["web-gui"]
    assert {"aiohttp", "yarl", "web_gui"} <= names["web-gui"] - names["base"]
    assert "dbus-daemon" in names["sensor-bench"]
    assert {"nginx", "openssl"} <= names["tls"]
    assert "xdg-dbus-proxy" in names["bluetooth"]
    assert not any(re.search("winrt|pyobjc|pytest|playwright", name) for found in names.values() for name in found)


def test_the_table_has_every_package() -> None:
    """`make licences` names each with its version, its licence and where it is."""
    table = bill.table()
    assert re.search(r"\| libusb1 \| [\d.]+ \| LGPL-2.1-or-later \(LGPL: .*\) \| sensor-bench \|", table)
    assert re.search(r"\| numpy \| [\d.]+ \| BSD-3-Clause.* \| all with ROS \|", table)


def test_packages_of_debian_are_read_from_every_form_of_the_command_or_refused() -> None:
    """Over several lines too; a command that is not understood is not read as none."""
    command = "RUN apt-get install -y --no-install-recommends nginx \\\n    openssl && apt-get clean\n"
    assert shipped._apt(command) == ["nginx", "openssl"]
    with pytest.raises(LookupError, match="no-install-recommends"):
        shipped._apt(command.replace("-y --no-install-recommends", "-qy"))
