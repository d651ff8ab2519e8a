# The wheel is compiled in the first stage and installed in the second one, which has no compiler.
FROM rust:1.95.0-slim-trixie AS build
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install --yes --no-install-recommends python3-venv \
    && rm -rf /var/lib/apt/lists/*
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
WORKDIR /src
COPY constraints.txt ./
RUN python3 -m venv /opt/build \
    && /opt/build/bin/pip install --constraint constraints.txt setuptools setuptools-rust
COPY pyproject.toml setup.py README.md LICENSE ./
COPY licenses licenses
COPY kernels kernels
COPY pricing_core pricing_core
COPY app app
RUN /opt/build/bin/pip wheel --no-deps --no-build-isolation --wheel-dir /opt/wheels .

FROM python:3.13-slim-trixie
RUN useradd --system --uid 10001 --no-create-home --shell /usr/sbin/nologin pricing
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
COPY requirements.txt /opt/requirements.txt
RUN python3 -m venv /opt/pricing \
    && /opt/pricing/bin/pip install --no-deps --require-hashes --requirement /opt/requirements.txt
COPY --from=build /opt/wheels /opt/wheels
# An image whose wheel has no kernel is a mistake.
RUN /opt/pricing/bin/pip install --no-deps --no-index --find-links /opt/wheels pricing-core \
    && /opt/pricing/bin/python -c "import pricing_core; assert pricing_core.kernel_name() == 'rust'"
ENV PATH=/opt/pricing/bin:$PATH PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1 MPLCONFIGDIR=/tmp/matplotlib \
    PRICING_HOST=0.0.0.0 PRICING_PORT=8000
USER 10001
EXPOSE 8000
HEALTHCHECK --interval=30s --timeout=5s --start-period=15s --retries=3 \
    CMD ["python", "-c", "import os, urllib.request; urllib.request.urlopen(f'http://127.0.0.1:{os.environ[\"PRICING_PORT\"]}/livez', timeout=4)"]
CMD ["pricing", "serve"]
