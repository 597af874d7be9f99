#!/usr/bin/env bash
# Builds every surface of a bench manifest in a process of its own and prints the table of benches/README.md.
#   benches/surfaces.sh [MANIFEST] [NAME…]
set -euo pipefail
cd "$(dirname "$0")/.."
manifest=${1:-benches/surfaces.toml}
shift || true
cargo build --release --quiet
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
names=("$@")
[ ${#names[@]} -gt 0 ] || mapfile -t names < <(sed -n 's/^\[surface\.\(.*\)\]$/\1/p' "$manifest")
for name in "${names[@]}"; do
    ./target/release/farfield build "$name" -m "$manifest" --out "$out/$name" --cache "$out/$name.cache" --quiet >"$out/$name.log" 2>&1 || cat "$out/$name.log"
done
python3 benches/surfaces.py "$out"/*/build.jsonl
