#!/bin/sh
# Starts Prometheus, which lets in whoever has the study's view token (web-config); what it answers no page of another site may read.
# A study that has no tokens, of `docker compose up` alone, shows it to whoever reaches the port, as our own services do.
set -eu
web=$(mktemp)
if [ -e "${SENSE4HRI_VIEW_TOKEN_FILE:-}" ]; then
    web-config > "$web"
else
    echo "no view token: whoever reaches this port may read; \`make up\` makes one" >&2
fi
exec prometheus --config.file="${PROMETHEUS_CONFIG:-/etc/prometheus/prometheus.yml}" \
    --storage.tsdb.path="${PROMETHEUS_FOLDER:-/prometheus}" --storage.tsdb.retention.time=30d \
    --web.config.file="$web" --web.cors.origin='^$' --web.listen-address="${PROMETHEUS_LISTEN:-0.0.0.0:9090}"
