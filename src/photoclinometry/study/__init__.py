"""Many simulated sites, mapped with many models: the tables and figures of the paper, against exact truth."""

from photoclinometry.study.plan import StudyOptions
from photoclinometry.study.work import run_study

__all__ = ["StudyOptions", "run_study"]
