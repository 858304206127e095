# Tandem in a container, to try it without building it on this machine:
#   docker build -t tandem .                                             the programs, in /opt/tandem
#   docker run --rm -v "$PWD/out:/out" tandem plan amble -o /out/amble.json
#   docker run --rm -v "$PWD/out:/out" tandem simulate /out/amble.json --out /out/amble
#   docker build -t tandem-demo --target demo . && docker run --rm -v "$PWD/out:/out" tandem-demo
# A linter reads this file in CI; no machine of the project has a Docker daemon.

FROM rust:1.95.0-slim-bookworm AS demo
SHELL ["/bin/bash", "-o", "pipefail", "-c"]
# Debian keeps one version of each in a release.
# hadolint ignore=DL3008
RUN apt-get update \
 && apt-get install --no-install-recommends -y g++ gcc git libegl1 libgl1-mesa-dri python3 python3-pip python3-venv \
 && rm -rf /var/lib/apt/lists/*
WORKDIR /tandem
COPY . .
RUN launch-scripts/install-ros /opt/tandem
CMD ["launch-scripts/demo", "--out", "/out"]

FROM debian:bookworm-slim
# hadolint ignore=DL3008
RUN apt-get update \
 && apt-get install --no-install-recommends -y libegl1 libgl1-mesa-dri \
 && rm -rf /var/lib/apt/lists/*
COPY --from=demo /opt/tandem /opt/tandem
ENV PATH="/opt/tandem/lib/tandem_cli:/opt/tandem/lib/tandem_planner:/opt/tandem/lib/tandem_controller:/opt/tandem/lib/tandem_sim_bridge:$PATH"
WORKDIR /out
ENTRYPOINT ["tandem"]
CMD ["--help"]
