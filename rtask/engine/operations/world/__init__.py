"""Operations about what is where."""
