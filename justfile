# Recipes for people; .ci/run and the scripts need no just.

# everything the server runs
ci:
    .ci/run

# MuJoCo's library, pinned
setup:
    launch-scripts/setup

# the main job
demo *ARGUMENTS:
    launch-scripts/demo {{ARGUMENTS}}

# every test
test *ARGUMENTS:
    launch-scripts/test {{ARGUMENTS}}

# benchmarks: dynamics, planner or control
bench *ARGUMENTS:
    launch-scripts/bench {{ARGUMENTS}}

# the documents as a site with search, in target/book
docs:
    launch-scripts/docs

# format and lints
lint:
    cargo fmt --all
    cargo clippy --workspace --release --all-targets --no-deps -- -D warnings
