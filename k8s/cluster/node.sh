#!/bin/bash
# A Kubernetes of one machine for tests, in namespaces of its own: node.sh CACHE WORK. CACHE is what build.sh prints; WORK is an empty folder for
# logs. When this script is ended, even by SIGKILL, all of it is gone but WORK and empty cgroups of its name. Needs root, Docker 20.10,
# cgroup v1, and memory: images and volumes lie in it, 1.2 GB with the study of the tests. Multicast between pods is dropped, as in most clusters.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
if [ "${3:-}" != inside ]; then
    exec unshare --mount --net --uts --ipc --pid --fork --kill-child --mount-proc "$0" "$1" "$2" inside
fi
cache=$1 work=$2 address=10.79.0.1 pods=10.79.0.0/24 services=10.96.0.0/16 token=admin

# Of this machine's files the node sees the programs; what it writes outside of WORK is in memory.
mount --make-rprivate /
for folder in /run /var/lib /var/log; do mount -t tmpfs -o mode=755,size=4g tmpfs "$folder"; done
mkdir /run/lock /run/kubernetes
mount --make-rshared /
hostname node
ip link set lo up
ip link add node0 type bridge
ip addr add "$address/24" dev node0
ip link set node0 up
ip route add "$services" dev node0
iptables -t raw -A PREROUTING -d 224.0.0.0/4 -j DROP

mkdir -p "$work/bin"
printf '#!/bin/sh\nLD_LIBRARY_PATH=%s/debian/usr/lib/x86_64-linux-gnu exec %s/debian/usr/sbin/conntrack "$@"\n' "$cache" "$cache" > "$work/bin/conntrack"
chmod 755 "$work/bin/conntrack"
export PATH=$work/bin:$cache/bin:$cache/debian/usr/bin:$PATH
cd /run/kubernetes
openssl genrsa -out sa.key 2048 2>/dev/null
echo "$token,admin,1,\"system:masters\"" > tokens.csv
cat > "$work/admin.conf" <<CONFIG
apiVersion: v1
kind: Config
clusters: [{name: node, cluster: {server: "https://$address:6443", insecure-skip-tls-verify: true}}]
users: [{name: admin, user: {token: $token}}]
contexts: [{name: node, context: {cluster: node, user: admin}}]
current-context: node
CONFIG
begin() { # name, command
    local name=$1
    shift
    "$@" > "$work/$name.log" 2>&1 &
}
ready() { kubectl --kubeconfig "$work/admin.conf" get --raw /readyz >/dev/null 2>&1; }

begin dockerd dockerd --bridge node0 --cgroup-parent "/$(basename "$work")" --host unix:///run/docker.sock \
    --add-runtime "oom=$here/runc-oom" --default-runtime oom
begin etcd etcd --data-dir etcd --unsafe-no-fsync
begin apiserver kube-apiserver --etcd-servers=http://127.0.0.1:2379 --service-cluster-ip-range="$services" --cert-dir "$PWD/certificates" --service-account-key-file=sa.key \
    --service-account-signing-key-file=sa.key --service-account-issuer=https://kubernetes.default.svc --token-auth-file=tokens.csv --authorization-mode=RBAC \
    --secure-port=6443 --kubelet-preferred-address-types=InternalIP --bind-address=0.0.0.0 --advertise-address="$address" --insecure-port=0
for _ in $(seq 300); do ready && break; sleep 0.5; done
kubectl=(kubectl --kubeconfig "$work/admin.conf")
begin controllers kube-controller-manager --kubeconfig "$work/admin.conf" --service-account-private-key-file=sa.key --leader-elect=false --cert-dir "$PWD/certificates"
begin scheduler kube-scheduler --kubeconfig "$work/admin.conf" --leader-elect=false
begin dns python3 "$here/dns.py" "$address" "$token"
begin proxy kube-proxy --kubeconfig "$work/admin.conf" --proxy-mode=iptables --conntrack-max-per-core=0 --conntrack-min=0 --conntrack-tcp-timeout-established=0 \
    --conntrack-tcp-timeout-close-wait=0 --hostname-override=node --cluster-cidr="$pods"
for _ in $(seq 120); do [ -S /run/docker.sock ] && docker --host unix:///run/docker.sock version >/dev/null 2>&1 && break; sleep 0.5; done
begin kubelet kubelet --kubeconfig "$work/admin.conf" --docker-endpoint=unix:///run/docker.sock --container-runtime=docker --cgroup-driver=cgroupfs \
    --pod-infra-container-image=sense4hri/pause:1 --fail-swap-on=false --eviction-hard= --hostname-override=node --node-ip="$address" --root-dir="$PWD/kubelet" \
    --cert-dir="$PWD/certificates" --cgroups-per-qos=false --enforce-node-allocatable= --resolv-conf= --cluster-dns="$address" --cluster-domain=cluster.local --oom-score-adj=0
wait
