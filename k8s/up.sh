#!/bin/bash
# Brings a study up in the cluster that kubectl talks to: k8s/up.sh OVERLAY, such as k8s/demo/single-node. The tokens are those of
# `make up`; they go in as the Secret `tokens`, by their files, and stand in no manifest.
set -euo pipefail
overlay=${1:?k8s/up.sh OVERLAY, such as k8s/demo/single-node}
study=$(basename "$(dirname "$overlay")")
made_by="$(dirname "$0")/../compose/study_tokens.py"
[ -f "$overlay/kustomization.yaml" ] || { echo "$overlay is no overlay: make k8s STUDY=$study writes it" >&2; exit 1; }
manifests=$(kubectl kustomize "$overlay")
if ! said=$(kubectl version 2>&1 >/dev/null); then
    echo "kubectl reaches no cluster: $said" >&2
    echo "kubectl config get-contexts lists those it knows" >&2
    exit 1
fi
operate=$(python3 "$made_by" "$study")
view=$(python3 "$made_by" "$study" view)
namespaces=$(sed -n 's/^  namespace: //p' <<< "$manifests" | sort -u)

for namespace in $namespaces; do
    kubectl create namespace "$namespace" --dry-run=client --output yaml | kubectl apply --filename - >/dev/null
    printf 'operate=%s\nview=%s\n' "$operate" "$view" | kubectl --namespace "$namespace" create secret generic tokens \
        --from-env-file=/dev/stdin --dry-run=client --output yaml | kubectl apply --filename - >/dev/null
done
kubectl apply --filename - <<< "$manifests"
namespace=$(head -n 1 <<< "$namespaces")
echo "the page: kubectl -n $namespace port-forward service/web-gui 8080, then http://127.0.0.1:8080/#token=$operate"
