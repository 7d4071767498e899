"""The list of deliberate faults that validation tries on the tests."""

from collections import Counter

import pytest
from validation.mutants import MUTANTS, TESTS
from validation.mutation import EVERY_MUTANT, locate
from validation.recent_mutants import RECENT_MUTANTS, RECENT_TESTS


@pytest.mark.slow
def test_every_fault_stands_once_in_the_sources_and_is_python():
    for mutant in EVERY_MUTANT:
        path = locate(mutant)
        compile(path.read_text(encoding="utf-8").replace(mutant.old, mutant.new), str(path), "exec")


def test_a_fault_of_a_young_module_stands_in_that_module():
    """Several sources have one name: the text tells which is meant, and may not have moved to another."""
    for mutant in RECENT_MUTANTS:
        assert locate(mutant).as_posix().endswith(f"/{mutant.module}"), mutant.name


def test_every_fault_has_a_name_of_its_own_and_tests_to_notice_it():
    assert len(MUTANTS) == 121
    assert len(RECENT_MUTANTS) >= len(EVERY_MUTANT) / 2
    assert max(Counter(mutant.name for mutant in EVERY_MUTANT).values()) == 1
    assert {mutant.module for mutant in MUTANTS} == set(TESTS)
    assert {mutant.module for mutant in RECENT_MUTANTS} == set(RECENT_TESTS)
