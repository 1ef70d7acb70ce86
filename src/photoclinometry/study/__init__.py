"""Many simulated sites mapped with many models: the paper's tables and figures, against exact truth."""

from photoclinometry.study.plan import StudyOptions
from photoclinometry.study.work import run_study

__all__ = ["StudyOptions", "run_study"]
