"""`bill.py licences`: a table of everything shipped. `bill.py sbom FOLDER`: a CycloneDX file for each image."""

import json
import sys
import uuid
from collections import defaultdict
from pathlib import Path
from typing import Any

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model import Property
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.output.json import JsonV1Dot6
from packageurl import PackageURL
from shipped import SAID, Part, images, parts

NAMESPACE = uuid.UUID("8d5f6f5e-6b1c-4d0a-9f0e-5e4853344852")
PURL = {"pypi": ("pypi", None, None), "deb": ("deb", "debian", {"distro": "bookworm"}), "ours": ("generic", None, None)}


def table() -> str:
    """Return every package with its licence and the images that hold it, as a table in Markdown."""
    holders: dict[Part, list[str]] = defaultdict(list)
    for image in images():
        for part in parts(image):
            holders[part].append(image)
    lines = ["| package | version | licence | images |", "|---|---|---|---|"]
    for part, held in sorted(holders.items(), key=lambda entry: (entry[0].kind, entry[0].name)):
        where = "all with ROS" if "base" in held else ", ".join(held)
        why = SAID["judged"].get(part.name, "")
        licence = f"{part.licence} ({why})" if why else part.licence
        lines.append(f"| {part.name} | {part.version or 'of Debian bookworm'} | {licence} | {where} |")
    return "\n".join([*lines, "", f"{len(holders)} packages in {len(images())} images, each on Debian bookworm."])


def sbom(image: str) -> str:
    """Return the bill of materials of one image: CycloneDX 1.6, JSON, the same for the same sources."""
    bom = Bom()
    own = parts(image)
    bom.metadata.component = Component(
        name=f"sense4hri/{image}", type=ComponentType.CONTAINER, bom_ref=f"sense4hri/{image}", version=_version(own)
    )
    for part in own:
        bom.components.add(_component(part))
    bom.components.add(Component(name="debian", version="12", type=ComponentType.OPERATING_SYSTEM, bom_ref="debian"))
    bom.register_dependency(bom.metadata.component, bom.components)
    told = json.loads(JsonV1Dot6(bom).output_as_string())
    told["metadata"].pop("timestamp", None)
    told["serialNumber"] = f"urn:uuid:{uuid.uuid5(NAMESPACE, repr(own))}"
    return json.dumps(told, indent=1, sort_keys=True) + "\n"


def _version(own: list[Part]) -> str | None:
    return next((part.version for part in own if part.kind == "ours"), None)


def _component(part: Part) -> Component:
    kind, namespace, qualifiers = PURL[part.kind]
    purl = PackageURL(kind, namespace, part.name, part.version or None, qualifiers)
    judged = SAID["judged"].get(part.name)
    about: dict[str, Any] = {"properties": [Property(name="sense4hri:judged", value=judged)]} if judged else {}
    return Component(
        name=part.name,
        version=part.version or None,
        type=ComponentType.APPLICATION if part.kind == "deb" else ComponentType.LIBRARY,
        licenses=[LicenseFactory().make_from_string(part.licence)],
        purl=purl,
        bom_ref=purl.to_string(),
        **about,
    )


def main(arguments: list[str]) -> int:
    """Print the table, or write the bills."""
    if arguments == ["licences"]:
        print(table())
        return 0
    if len(arguments) != 2 or arguments[0] != "sbom":
        print(__doc__, file=sys.stderr)
        return 2
    folder = Path(arguments[1])
    folder.mkdir(parents=True, exist_ok=True)
    for image in images():
        (folder / f"{image}.cdx.json").write_text(sbom(image))
    print(f"{len(images())} bills of materials in {folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
