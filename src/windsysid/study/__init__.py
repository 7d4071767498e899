"""The published study, reproduced: scenario, arms, tables, figures."""

from windsysid.study.run import PUBLISHED, Study, run_study

__all__ = ["PUBLISHED", "Study", "run_study"]
