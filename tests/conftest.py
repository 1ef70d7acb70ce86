import pytest


@pytest.fixture(scope="session")
def mapped(tmp_path_factory):
    """A small simulated site and the run that mapped it (`runs.Mapped`); for reading only."""
    from runs import map_small_site

    return map_small_site(tmp_path_factory.mktemp("mapped"))
