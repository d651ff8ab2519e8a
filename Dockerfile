# Debian 13 is named because its cargo (1.85) is the oldest that builds the kernel.
FROM python:3.11-slim-trixie AS build
RUN apt-get update \
    && apt-get install --yes --no-install-recommends cargo \
    && rm -rf /var/lib/apt/lists/*
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_CONSTRAINT=/src/constraints.txt
WORKDIR /src
COPY constraints.txt ./
RUN python -m venv /opt/pricing \
    && /opt/pricing/bin/pip install pip setuptools setuptools-rust
COPY pyproject.toml README.md LICENSE ./
COPY kernels kernels
COPY pricing_core pricing_core
COPY app app
COPY benchmarks benchmarks
# The extension is optional for an ordinary install; an image without it is a mistake.
RUN /opt/pricing/bin/pip install --no-build-isolation . \
    && cd / \
    && /opt/pricing/bin/python -c "import pricing_core; assert pricing_core.kernel_name() == 'rust'"

FROM python:3.11-slim-trixie
RUN useradd --system --uid 10001 --no-create-home --shell /usr/sbin/nologin pricing
COPY --from=build /opt/pricing /opt/pricing
ENV PATH=/opt/pricing/bin:$PATH PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1 MPLCONFIGDIR=/tmp/matplotlib
USER pricing
EXPOSE 8000
HEALTHCHECK --interval=30s --timeout=5s --start-period=15s --retries=3 \
    CMD ["python", "-c", "import urllib.request; urllib.request.urlopen('http://127.0.0.1:8000/livez', timeout=4)"]
CMD ["pricing", "serve", "--host", "0.0.0.0", "--port", "8000"]
