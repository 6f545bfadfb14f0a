#!/bin/bash
# Builds the base image, one image per service, Prometheus, the D-Bus proxy and the HTTPS proxy: compose/images.sh [service ...]. Needs a Docker Engine, no registry:
# where none can be reached, debian:bookworm-slim is made from Debian's packages.
set -euo pipefail
cd "$(dirname "$0")/.."
docker=compose/docker.sh
debian=debian:bookworm-slim
mkdir -p build
scratch=$(mktemp -d build/images.XXXXXX)
trap 'rm -rf "$scratch"' EXIT

step() { # name, command: a line at its start, one with the duration at its end, beside what the command says on 3
    local started=$SECONDS
    echo "images: $1 ..."
    if ! "${@:2}" 3>&1 > "$scratch/log" 2>&1; then
        tail -n 60 "$scratch/log" >&2
        echo "images: $1 failed, see above" >&2
        exit 1
    fi
    echo "images: $1: $((SECONDS - started)) s"
}

debian_from_packages() {
    command -v debootstrap >/dev/null || { echo "Missing on this system: debootstrap. On Debian: apt-get install debootstrap"; return 1; }
    local mirror
    mirror=$(apt-get indextargets --format '$(SITE)' 'Codename: bookworm' | head -n 1)
    [ "$(id -u)" = 0 ] || { echo "debootstrap needs root: run make images once as root"; return 1; }
    timeout 600 debootstrap --variant=minbase bookworm "$scratch/debian" ${mirror:+"$mirror"} || return 1
    rm -rf "$scratch"/debian/var/cache/apt/archives/*.deb "$scratch"/debian/var/lib/apt/lists/*
    tar -C "$scratch/debian" -c . | $docker import - "$debian" || return 1
    rm -rf "$scratch/debian"
}

# What the build needs of the host's network setup goes in as secrets: it stays out of every layer.
touch "$scratch/index"
for pip in .venv/bin/pip pip3 pip; do
    if command -v "$pip" >/dev/null; then
        "$pip" config get global.index_url > "$scratch/index" 2>/dev/null || true
        break
    fi
done
secrets=(--secret "id=index,src=$scratch/index")
ca=${PIP_CERT:-${SSL_CERT_FILE:-/etc/ssl/certs/ca-certificates.crt}}
if [ -f "$ca" ]; then secrets+=(--secret "id=ca,src=$ca"); fi

build() { # tag, Dockerfile, options; a build that stalls (seen with Docker 20.10 on a busy machine) goes on from its cache, on a slow network with more time
    local limit_s
    for limit_s in 480 1920 7680; do
        timeout "$limit_s" $docker build --progress plain "${secrets[@]}" --tag "$1" --tag "$1:$release" --file "$2" "${@:3}" . </dev/null && return
        [ $? = 124 ] || return 1
        echo "images: $1 did not end within $limit_s s" >&3
    done
    return 1
}

if ! said=$($docker version 2>&1 >/dev/null); then
    echo "No Docker Engine answers: ${said:-no reason given}" >&2
    echo "Where there is none, on Debian or Ubuntu: apt-get install docker.io; where permission is denied: as root, or as a user in the group docker" >&2
    exit 1
fi
if ! $docker image inspect "$debian" >/dev/null 2>&1 && ! timeout 60 $docker pull --quiet "$debian" >/dev/null 2>&1; then
    step "$debian from Debian's packages" debian_from_packages
fi
release=$(cat VERSION) # k8s/ names images by it; a checkout's own version goes in as SENSE4HRI_VERSION
step "sense4hri/tools" build sense4hri/tools interfaces/Dockerfile --target tools
step "sense4hri/base" build sense4hri/base interfaces/Dockerfile
if [ $# -eq 0 ]; then set -- $(cd services && ls -d */ | tr -d /) bluetooth prometheus alertmanager tls; fi
version=$(python3 interfaces/sense4hri/src/sense4hri/version.py)
for name in "$@"; do
    if [ -f "compose/$name/Dockerfile" ]; then
        step "sense4hri/$name" build "sense4hri/$name" "compose/$name/Dockerfile"
    else
        step "sense4hri/$name" build "sense4hri/$name" services/Dockerfile \
            --build-arg "SERVICE=$name" --build-arg "SENSE4HRI_VERSION=$version"
    fi
done
