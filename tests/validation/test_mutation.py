"""The list of deliberate faults that validation tries on the tests."""

from collections import Counter

from validation.mutants import MUTANTS, TESTS
from validation.mutation import locate


def test_every_fault_stands_once_in_the_sources_and_is_python():
    for mutant in MUTANTS:
        path = locate(mutant)
        compile(path.read_text(encoding="utf-8").replace(mutant.old, mutant.new), str(path), "exec")


def test_every_fault_has_a_name_of_its_own_and_tests_to_notice_it():
    assert len(MUTANTS) == 121
    assert max(Counter(mutant.name for mutant in MUTANTS).values()) == 1
    assert {mutant.module for mutant in MUTANTS} == set(TESTS)
