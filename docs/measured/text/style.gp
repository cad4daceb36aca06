# SPDX-License-Identifier: Apache-2.0
# What the pictures of docs/measured share.  dir: where measured_page left the points; out: the picture.
set terminal pngcairo size 1000,350 noenhanced font "sans,10" background rgb "white"
set output out
set grid linecolor rgb "#dddddd"
set border 3 linecolor rgb "#555555"
set tics nomirror
set key top right samplen 1
up = "#1f6fb4"
down = "#c44e1a"
grey = "#555555"
