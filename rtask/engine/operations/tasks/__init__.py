"""Operations about what robots are to do."""
