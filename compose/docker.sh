#!/bin/bash
# The Docker command line that can use BuildKit: a newer one without its buildx plugin cannot, Debian's 20.10 can by itself.
set -eu
docker=docker
if ! docker buildx version >/dev/null 2>&1 && [ -x /usr/bin/docker ]; then docker=/usr/bin/docker; fi
export DOCKER_BUILDKIT=1
exec "$docker" "$@"
