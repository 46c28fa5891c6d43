"""An order of a function's instructions that CasADi's virtual machine takes less time for.

The machine jumps to the code of an instruction by its operation, and a processor that has guessed
another operation loses more time than an addition takes. In the order in which CasADi finds the
instructions, depth first, operations alternate. Here they are in groups of one operation each, as
large as their operands allow. What is computed remains the same, bit for bit.
"""

from __future__ import annotations

from collections import defaultdict
from weakref import WeakKeyDictionary

import casadi as ca

#: The functions of a process that have been grouped: every world of a sweep has the same ones.
_GROUPED: WeakKeyDictionary[ca.Function, ca.Function] = WeakKeyDictionary()


def is_grouped(function: ca.Function) -> bool:
    """Whether it has been grouped before."""
    return function in _GROUPED


def grouped(function: ca.Function) -> ca.Function:
    """The function with its instructions in groups of one operation each.

    CasADi keeps the order in which it finds expressions. So they all are operands, in that order,
    of one that comes first and computes nothing.

    Args:
        function: of scalar expressions.

    Returns:
        A function of the same arguments, with a number of no meaning before its results.
    """
    found = _GROUPED.get(function)
    if found is None:
        _GROUPED[function] = found = _grouped(function)
    return found


def _grouped(function: ca.Function) -> ca.Function:
    arguments = function.sx_in()
    order, written = _order(function)
    values = ca.vertcat(function.instructions_sx(), *(each.nz[:] for each in arguments))
    operands = values.nz[order]
    symbols = ca.SX.sym("operands", operands.numel())
    nothing = ca.Function("nothing", [symbols], [ca.SX(0)], {"never_inline": True})
    results = [
        ca.SX(function.sparsity_out(i), values.nz[numbers])
        if numbers
        else ca.SX(function.sparsity_out(i))
        for i, numbers in enumerate(written)
    ]
    return ca.Function(function.name(), arguments, [nothing(operands), *results])


def _order(function: ca.Function) -> tuple[list[int], list[list[int]]]:
    """Numbers of all values in their new order, and of those that each result has.

    The numbers of arguments follow on those of instructions.
    """
    count = function.n_instructions()
    first, leaves = [count], []
    for i in range(function.n_in()):
        first.append(first[i] + function.nnz_in(i))
    results = [[0] * function.nnz_out(i) for i in range(function.n_out())]
    operations: dict[int, int] = {}
    users: dict[int, list[int]] = {}
    missing: dict[int, int] = {}
    ready: dict[int, list[int]] = defaultdict(list)
    # What lies in each place of memory, as instructions go on.
    held: dict[int, int] = {}
    for k in range(count):
        operation, read = function.instruction_id(k), function.instruction_input(k)
        written = function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            results[written[0]][written[1]] = held[read[0]]
            continue
        if operation == ca.OP_INPUT:
            held[written[0]] = first[read[0]] + read[1]
            leaves.append(first[read[0]] + read[1])
            continue
        if operation == ca.OP_CONST:
            leaves.append(k)
        else:
            operations[k], users[k] = operation, []
            computed = {held[place] for place in read} & operations.keys()
            missing[k] = len(computed)
            for operand in computed:
                users[operand].append(k)
            if not computed:
                ready[operation].append(k)
        held[written[0]] = k
    return leaves + _groups(operations, users, missing, ready), results


def _groups(
    operations: dict[int, int],
    users: dict[int, list[int]],
    missing: dict[int, int],
    ready: dict[int, list[int]],
) -> list[int]:
    """What is computed, the largest group that is ready first.

    Args:
        operations: by number.
        users: what has it as an operand.
        missing: how many operands are not yet in order; changed.
        ready: numbers by operation that have all of them; changed.
    """
    order: list[int] = []
    while len(order) < len(operations):
        operation = max(ready, key=lambda each: len(ready[each]))
        # What the group itself makes ready, of the same operation, belongs to it.
        group = ready.pop(operation)
        for k in group:
            for user in users[k]:
                missing[user] -= 1
                if not missing[user]:
                    own = operations[user]
                    (group if own == operation else ready[own]).append(user)
        order += group
    return order
