#!/bin/bash
# Prints the operate token of the studies of this checkout: SENSE4HRI_OPERATE_TOKEN where it is set, else the one made at the first
# call and kept in compose/.operate-token, readable for its owner alone and no part of the repository.
set -euo pipefail
file="$(dirname "$0")/.operate-token"
if [ -n "${SENSE4HRI_OPERATE_TOKEN:-}" ]; then
    printf '%s\n' "$SENSE4HRI_OPERATE_TOKEN"
    exit
fi
umask 077
if [ ! -s "$file" ]; then
    head -c 24 /dev/urandom | base64 | tr '+/' '-_' > "$file"
fi
cat "$file"
