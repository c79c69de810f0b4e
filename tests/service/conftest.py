import pytest

from service import Service


@pytest.fixture
def new_service(build, tmp_path):
    """Makes services in directories of their own; all are gone after the test."""
    made = []

    def make(*options, base=None):
        where = base or tmp_path / f"service.{len(made)}"
        where.mkdir(exist_ok=True)
        made.append(Service(build, where, *options))
        return made[-1]

    yield make
    for service in made:
        service.clean_up()


@pytest.fixture
def service(new_service):
    return new_service().start()
