# The service in a container. Build: `make image`. Run:
#
#   docker run --init -p 127.0.0.1:8321:8321 -v needlebench:/data -e NEEDLEBENCH_API_KEY=some-long-secret needlebench
#
# The key is required, since inside a container the service listens on every address. Jobs, results and recordings
# live in the volume /data. The root may be read-only: add `--read-only --tmpfs /tmp`. compose.yaml says all of this.

FROM python:3.12-slim AS build
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
WORKDIR /source

# What running and building need, checked against the hashes of the lock; later steps see nothing but this folder.
COPY requirements.lock ./
RUN pip download --require-hashes --only-binary=:all: --no-deps --dest /wheels --requirement requirements.lock

COPY . .
ARG COMMIT=""
RUN python -m venv /builder \
 && /builder/bin/pip install --no-index --find-links /wheels hatchling \
 && NEEDLEBENCH_COMMIT="$COMMIT" /builder/bin/python -m hatchling build --target wheel --directory /wheels

# The run-time packages alone: the build backend stays behind in /wheels.
RUN python -m venv --without-pip /opt/needlebench \
 && pip --python /opt/needlebench/bin/python install --no-index --find-links /wheels needlebench

# Rerun's command line would send usage data; the switch is a file, written here and read-only later.
RUN CI=1 XDG_CONFIG_HOME=/opt/needlebench/etc XDG_DATA_HOME=/tmp/rerun /opt/needlebench/bin/rerun analytics disable \
 && chmod -R a+rX /opt/needlebench/etc


FROM python:3.12-slim
LABEL org.opencontainers.image.title="needlebench" \
      org.opencontainers.image.description="Reproducible benchmarks for robotic needle steering in deforming tissue" \
      org.opencontainers.image.licenses="Apache-2.0 AND MIT"
COPY --from=build /opt/needlebench /opt/needlebench
RUN mkdir /data && chown 10001:10001 /data
ENV PATH=/opt/needlebench/bin:$PATH \
    HOME=/data \
    NEEDLEBENCH_DATA=/data \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    XDG_CACHE_HOME=/data/.cache \
    XDG_CONFIG_HOME=/opt/needlebench/etc
USER 10001:10001
WORKDIR /data
VOLUME /data
EXPOSE 8321
HEALTHCHECK --interval=30s --timeout=5s --start-period=60s --retries=3 CMD ["python", "-c", \
  "import urllib.request as u; u.build_opener(u.ProxyHandler({})).open('http://127.0.0.1:8321/healthz', timeout=4)"]
CMD ["needlebench", "serve", "--host", "0.0.0.0", "--port", "8321", "--data", "/data"]
