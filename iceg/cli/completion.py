"""Completion of commands, flags and choices for a shell: `iceg --completion bash`, `zsh` or `fish` prints it."""

import dataclasses
import typing
from typing import Any, Literal, get_args, get_origin

from iceg.cli.commands import COMMANDS, Entry
from iceg.cli.settings_flags import setting_names, setting_type
from iceg.cli.usage_error import UsageError

SHELLS = ("bash", "zsh", "fish")

_BASH = """\
# Completion of iceg: eval "$(iceg --completion bash)", or this text in a file of bash-completion.
_iceg() {
    local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD-1]} command=${COMP_WORDS[1]}
    COMPREPLY=()
    if [[ $COMP_CWORD -eq 1 ]]; then
        COMPREPLY=($(compgen -W "@COMMANDS@" -- "$current"))
        return
    fi
    case "$command $previous" in
@CHOICES@
    esac
    if [[ $current == -* ]]; then
        case $command in
@FLAGS@
        esac
        return
    fi
    local IFS=$'\\n'
    COMPREPLY=($(compgen -f -- "$current"))
}
complete -o filenames -F _iceg iceg
"""
_ZSH = """\
# Completion of iceg: eval "$(iceg --completion zsh)"
autoload -U +X compinit && compinit
autoload -U +X bashcompinit && bashcompinit
"""


def completion(words: list[str]) -> str:
    """What the shell named reads to complete the words of `iceg`.

    Args:
        words: what follows `--completion`: the name of the shell.

    Raises:
        UsageError: none, or another shell.
    """
    if len(words) != 1 or words[0] not in SHELLS:
        raise UsageError(f"found --completion {' '.join(words)[:40]}, expected one of {', '.join(SHELLS)}")
    if words[0] == "fish":
        return _fish()
    return _bash() if words[0] == "bash" else _ZSH + _bash()


def _bash() -> str:
    flags, choices = [], []
    for name, entry in COMMANDS.items():
        offered = _flags(entry)
        flags.append(f'            {name}) COMPREPLY=($(compgen -W "{" ".join(offered)}" -- "$current")) ;;')
        choices += [
            f'        "{name} {flag}") COMPREPLY=($(compgen -W "{" ".join(values)}" -- "$current")); return ;;'
            for flag, values in offered.items()
            if values
        ]
    commands = " ".join([*COMMANDS, "--help", "--version", "--completion"])
    return (
        _BASH.replace("@COMMANDS@", commands)
        .replace("@CHOICES@", "\n".join(choices))
        .replace("@FLAGS@", "\n".join(flags))
    )


def _fish() -> str:
    lines = ["# Completion of iceg: iceg --completion fish | source"]
    for name, entry in COMMANDS.items():
        told = (entry.kind.__doc__ or "").partition("\n")[0].replace("'", "\\'")
        lines.append(f"complete -c iceg -n __fish_use_subcommand -a {name} -d '{told}'")
        for flag, values in _flags(entry).items():
            offered = f" -x -a '{' '.join(values)}'" if values else ""
            lines.append(f"complete -c iceg -n '__fish_seen_subcommand_from {name}' -l {flag[2:]}{offered}")
    return "\n".join(lines) + "\n"


def _flags(entry: Entry) -> dict[str, tuple[str, ...]]:
    """The long flags of a command, each with its choices if it has any."""
    hints = typing.get_type_hints(entry.kind)
    annotated = typing.get_type_hints(entry.kind, include_extras=True)
    flags = {
        f"--{'no-' if field.default is True else ''}{field.name.replace('_', '-')}": _choices(hints[field.name])
        for field in dataclasses.fields(entry.kind)
        if field.name != "settings" and not _is_positional(annotated[field.name])
    }
    settings = entry.settings
    for name, hint in (
        () if settings is None else ((each, setting_type(settings, each)) for each in setting_names(settings))
    ):
        flag = f"{entry.prefix}{name}".replace("_", "-")
        flags[f"--{flag}"] = _choices(hint)
        if hint is bool:
            stage, dot, last = flag.rpartition(".")
            flags[f"--{stage}{dot}no-{last}"] = ()
    return {**flags, "--help": (), "--help-all": ()}


def _choices(hint: Any) -> tuple[str, ...]:  # noqa: ANN401
    """The values of a choice, looked for inside what may be left out or given several times."""
    if get_origin(hint) is Literal:
        return tuple(map(str, get_args(hint)))
    return next(filter(None, (_choices(inner) for inner in get_args(hint))), ())


def _is_positional(hint: Any) -> bool:  # noqa: ANN401
    import tyro

    return tyro.conf.Positional in getattr(hint, "__metadata__", ())
