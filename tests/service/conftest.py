"""What the service's tests share with those of the drives."""

from tests.drives.conftest import bench as bench
