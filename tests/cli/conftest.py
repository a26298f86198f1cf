"""The command line in this process, for the tests of the verbs."""

from tests.conftest import Command as Command
