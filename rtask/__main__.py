"""``python -m rtask`` is the ``rtask`` command."""

from rtask.cli import main

if __name__ == "__main__":
    main()
