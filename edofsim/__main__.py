"""`python -m edofsim`, the same as `edofsim`; several GPUs: `torchrun -m edofsim train ...`."""

from .cli import main

if __name__ == "__main__":
    main()
