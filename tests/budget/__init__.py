"""The budget of instructions: what each command costs, counted, and compared with the figures of `instructions.json`.

Times depend on the machine and on its neighbours; the number of instructions of one build does not. A figure holds for
one environment (interpreter, compiler, libraries, valgrind), which stands beside it. In any other environment the
commit that wrote the figures last is built and counted as well, and the two counts are compared.
"""
