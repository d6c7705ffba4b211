# The tool without a screen: docker build -t isac-cosim . && docker run --rm -v "$PWD/results:/work/results" isac-cosim run
FROM python:3.11.13-slim-bookworm

# What SUMO's libraries link to, beside what its wheels bring.
RUN apt-get update \
    && apt-get install --no-install-recommends --yes libgomp1 \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /opt/isac-cosim
COPY . .
# pip takes a build of torch with several gigabytes of CUDA. For the build for the CPU that PyTorch offers elsewhere:
# docker build --build-arg TORCH="torch --index-url ITS_ADDRESS" ...
ARG TORCH="torch"
RUN pip install --no-cache-dir ${TORCH} \
    && pip install --no-cache-dir .

RUN useradd --create-home --uid 1000 cosim \
    && mkdir /work \
    && chown cosim /work
USER cosim
WORKDIR /work

ENTRYPOINT ["cosim"]
CMD ["--help"]
