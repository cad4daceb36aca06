# SPDX-License-Identifier: Apache-2.0
load "docs/measured/text/style.gp"
set multiplot layout 1,2
set title "joint 2: motor torque less link sensor, held-out runs"
set xlabel "load (link sensor), N.m"
set ylabel "loss, N.m"
set yrange [-9:13]
plot dir."/residual.dat" using ($1==2 && $8>0 ? $7 : NaN):6 with points pt 7 ps 0.3 lc rgb up title "positive motion", \
     "" using ($1==2 && $8<0 ? $7 : NaN):6 with points pt 7 ps 0.3 lc rgb down title "negative motion"
set yrange [0:*]
set title "lines at steady speed (joint_k_trapez)"
set xlabel "order, periods a motor turn"
set ylabel "amplitude, N.m"
set xrange [0:30]
set xtics 0,2,30
plot dir."/steady.dat" using ($1==7 ? $2/100 : NaN):3 with lines lc rgb up title "joint 7", \
     "" using ($1==5 ? $2/100 : NaN):3 with lines lc rgb down title "joint 5"
