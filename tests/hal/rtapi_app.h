/* SPDX-License-Identifier: Apache-2.0 */
/* See hal.h: what a module says of itself is nothing here. */
#ifndef RTAPI_APP_H
#define RTAPI_APP_H

#define MODULE_AUTHOR(words) struct rtapi_nothing
#define MODULE_DESCRIPTION(words) struct rtapi_nothing
#define MODULE_LICENSE(words) struct rtapi_nothing
#define RTAPI_MP_STRING(name, words) struct rtapi_nothing

int rtapi_app_main(void);
void rtapi_app_exit(void);

#endif
