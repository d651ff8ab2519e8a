"""The version of the installed distribution."""

from importlib.metadata import version

ENGINE_VERSION = version("pricing-core")
