#!/bin/sh
# Starts Alertmanager with the address of ALERT_WEBHOOK in its configuration, with nobody to tell where there is none. It lets in whoever
# has the study's view token (web-config).
set -eu
given=${ALERTMANAGER_CONFIG:-/etc/prometheus/alertmanager.yml} folder=${ALERTMANAGER_FOLDER:-/tmp}
used=$folder/alertmanager.yml
case "${ALERT_WEBHOOK:-}" in
    "") cp "$given" "$used" ;;
    http://*[\"\|\ ]* | https://*[\"\|\ ]*) echo "ALERT_WEBHOOK must be an address without quotes, bars and spaces" >&2; exit 78 ;;
    http://* | https://*)
        address=$(printf %s "$ALERT_WEBHOOK" | sed 's/[\\&]/\\&/g') # as it is: sed has a meaning for both signs
        sed -e "s|http://alert-webhook.invalid/|$address|" -e "s|receiver: nobody.*|receiver: webhook|" "$given" > "$used"
        ;;
    *) echo "ALERT_WEBHOOK must begin with http:// or https://" >&2; exit 78 ;;
esac
web=$(mktemp)
web-config > "$web"
exec prometheus-alertmanager --config.file="$used" --storage.path="$folder" --cluster.listen-address= \
    --web.config.file="$web" --web.listen-address="${ALERTMANAGER_LISTEN:-0.0.0.0:9093}"
