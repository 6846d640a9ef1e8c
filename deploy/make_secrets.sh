#!/bin/sh
# Makes the secrets that docker-compose.yml and cluster/compose.yml read, each in a file of its own; existing ones stay.
set -eu
umask 077
cd "$(dirname "$0")"
mkdir -p secrets
# Other users of this machine reach no file in it.
chmod 700 secrets
random() { od -An -N24 -tx1 /dev/urandom | tr -d ' \n'; }
make() { [ -s "secrets/$1" ] || printf '%s' "$2" >"secrets/$1"; }
make database-password "$(random)"
make database-url "postgresql://fvs:$(cat secrets/database-password)@database:5432/fvs"
make blobs-access-key-id fvs
make blobs-secret-access-key "$(random)"
keys="{\"accessKey\": \"fvs\", \"secretKey\": \"$(cat secrets/blobs-secret-access-key)\"}"
make store-identities "{\"identities\": [{\"name\": \"fvs\", \"credentials\": [$keys], \"actions\": [\"Admin\"]}]}"
make ray-token "$(random)"
make grafana-password "$(random)"
make metrics-key "replace this by a key: docker compose run --rm fvs keys create prometheus --scope read"
# Compose mounts each file by itself, with its mode, into the containers that name it; there users of their own read it.
chmod 644 secrets/*
