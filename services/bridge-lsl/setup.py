import os

from setuptools import setup

# A build from a checkout names the commit, as in 0.2.0+37.g90e5ed1; without it the release alone is known.
# Here and not in pyproject.toml, because colcon cannot read a requires-python from there.
setup(version=os.environ.get("SENSE4HRI_VERSION", "0.2.0"), python_requires=">=3.11")
