"""``python -m validation.adversary``."""

from validation.adversary.campaign import main

main()
