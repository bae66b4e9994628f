#!/bin/sh
# Asks before something is installed as root: confirm.sh WHAT. Exit code 0 to go on; CI=true goes on without a question.
[ "${CI:-}" != true ] || { echo "treadline: $1" >&2; exit 0; }
[ -t 0 ] || { echo "treadline: $1: needs a yes, and there is no terminal to ask; set CI=true to go on" >&2; exit 2; }
printf 'treadline: %s; go on? [y/N] ' "$1" >&2
read -r answer
case $answer in [yY] | [yY][eE][sS]) exit 0 ;; esac
echo "treadline: nothing was installed" >&2
exit 2
