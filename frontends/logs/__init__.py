"""Readers of recorded logs, one format a file."""

from frontends.logs.errors import LogError
from frontends.logs.info import LogInfo, describe_log
from frontends.logs.readers import READERS, read_log

__all__ = ["READERS", "LogError", "LogInfo", "describe_log", "read_log"]
