"""``rtask grasp``: the group of commands that plan grasps."""

from __future__ import annotations

import click

from rtask.cli.grasping.batch import batch
from rtask.cli.grasping.learning import train
from rtask.cli.grasping.push import push
from rtask.cli.grasping.scene import scene
from rtask.cli.grasping.space import space

__all__ = ["grasp"]


class _Planners(click.Group):
    """A group that says which of its commands has an option that another was given."""

    def invoke(self, ctx: click.Context) -> object:
        try:
            return super().invoke(ctx)
        except click.NoSuchOption as error:
            owners = [
                f"rtask grasp {name}"
                for name, command in self.commands.items()
                if any(error.option_name in parameter.opts for parameter in command.params)
            ]
            if not owners:
                raise
            message = f"{error.message} It is an option of {', '.join(owners)}."
            raise click.NoSuchOption(error.option_name, message, ctx=error.ctx) from error

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args[0] == "plan":
            ctx.fail(
                "No such command 'plan'. `push` plans on a plane, `space` in space, and `scene` "
                "for all objects on a table."
            )
        return super().resolve_command(ctx, args)


@click.group(cls=_Planners)
def grasp() -> None:
    """Plan grasps under uncertainty."""


for _command in (push, space, scene, batch, train):
    grasp.add_command(_command)
