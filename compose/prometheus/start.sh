#!/bin/sh
# Starts Prometheus, which lets in whoever has the study's view token (web-config); what it answers no page of another site may read.
set -eu
web=$(mktemp)
web-config > "$web"
exec prometheus --config.file="${PROMETHEUS_CONFIG:-/etc/prometheus/prometheus.yml}" \
    --storage.tsdb.path="${PROMETHEUS_FOLDER:-/prometheus}" --storage.tsdb.retention.time=30d \
    --web.config.file="$web" --web.cors.origin='^$' --web.listen-address="${PROMETHEUS_LISTEN:-0.0.0.0:9090}"
