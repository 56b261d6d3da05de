# Report that a command was killed or crashed under a memory limit. Argument: its exit status.
case $1 in
137)
    echo "egosplat: the stage was killed, most likely for lack of memory: free some, or see docs/running.md for settings that need less." \
        "The same command continues from here" >&2
    ;;
134 | 139) # SIGABRT and SIGSEGV: how libraries end without memory
    [ "$(ulimit -v)" = unlimited ] ||
        echo "egosplat: the stage crashed, most likely because ulimit -v allows $(ulimit -v) KiB, and PyTorch's libraries" \
            "alone map up to 4,000,000: raise it, or set none. The same command continues from here" >&2
    ;;
esac
