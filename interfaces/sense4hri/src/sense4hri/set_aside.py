"""What a service does with a file of its own that is damaged: it keeps it under another name and goes on. Pure."""

import errno
import time
from pathlib import Path


def set_aside(path: Path) -> Path:
    """Rename a file to `<name>.damaged-<UTC>`, which nobody reads, and return that.

    Raises OSError where it cannot be renamed or is no regular file: a folder or a device is a mistake, no damage.
    """
    if not path.is_file():
        raise OSError(errno.EINVAL, "is no regular file", str(path))
    name = f"{path.name}.damaged-{time.strftime('%Y%m%dT%H%M%SZ', time.gmtime())}"
    names = (name, *(f"{name}-{number}" for number in range(2, 1000)))
    return path.rename(next(there for one in names if not (there := path.with_name(one)).exists()))
