"""The published study, reproduced, and what is measured beyond it: each module is a command, ``python -m windsysid.study.NAME``."""

__all__: list[str] = []
