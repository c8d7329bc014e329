"""`python -m dermis`."""

from dermis._program import main

if __name__ == "__main__":
    main()
