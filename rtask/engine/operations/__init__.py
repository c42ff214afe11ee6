"""Operations for robots and people, one file each."""
