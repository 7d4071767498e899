"""The published study, reproduced; each module is a command, ``python -m windsysid.study.NAME``."""

__all__: list[str] = []
