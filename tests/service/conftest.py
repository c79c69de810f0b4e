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


@pytest.fixture(scope="module")
def data_service(build, shared_data, tmp_path_factory):
    """One daemon for all tests of a file, open to the shared data."""
    made = Service(build, tmp_path_factory.mktemp("service"), "--input_roots", shared_data)
    yield made.start()
    made.clean_up()
