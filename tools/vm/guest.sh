#!/bin/sh
# Runs in the guest: /dev/vdb is a tar file of the checkout, /dev/vdc takes the results, port 0xf4 the verdict.
checkout=/srv/stagectl results=/var/tmp/results
mkdir -p $results /run/tests
cd $checkout || exit
export STAGECTL_VM=1 STAGECTL_KERNELS=interpreted OPENBLAS_NUM_THREADS=1 PYTHONUNBUFFERED=1 XDG_RUNTIME_DIR=/run/tests
echo "guest: $(uname -rv), $(systemctl --version | head -n 1)"
export PYTEST_DISABLE_PLUGIN_AUTOLOAD=1
xargs -d '\n' -a arguments python3 -m pytest --confcutdir tests/vm 2>&1
code=$?
journalctl --no-pager -o short-monotonic > $results/journal.txt
tar -cf /dev/vdc -C $results .
sync
[ $code -eq 0 ] && verdict='\000' || verdict='\001'
printf "$verdict" | dd of=/dev/port bs=1 seek=244 conv=notrunc 2>/dev/null
systemctl poweroff --force --force
