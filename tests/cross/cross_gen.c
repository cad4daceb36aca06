/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Table images as C source for cross_core.c: those named on the command line, then random arms of 1 to
 * 16 joints with every term on.
 * usage: cross_gen NAME=FILE.hdtm... >images.c
 *        cross_gen --files DIRECTORY          random arms only, a file each
 */
#include <stdio.h>
#include <string.h>

#include "ctrl/hdt_tables.h"
#include "tests/core_reference.h"

#define IMAGE_MAX 131072

static uint8_t image[IMAGE_MAX];
static struct hdt_tables tables;
static char list[4096];

static const char *files; /* directory for one image a file, or NULL: C source */

static void put(const char *name, size_t size)
{
    if (files != NULL) {
        char path[1024];
        snprintf(path, sizeof path, "%s/%s.hdtm", files, name);
        FILE *f = fopen(path, "wb");
        if (f == NULL || fwrite(image, 1, size, f) != size || fclose(f) != 0) {
            perror(path);
            exit(1);
        }
        return;
    }
    printf("static const uint8_t image_%s[%zu] = {", name, size);
    for (size_t i = 0; i < size; i++)
        printf("%s%u,", i % 24 == 0 ? "\n    " : "", image[i]);
    printf("\n};\n");
    snprintf(list + strlen(list), sizeof list - strlen(list), "    {\"%s\", %zu, image_%s},\n", name, size,
             name);
}

int main(int argc, char **argv)
{
    uint64_t r = 20260101;
    if (argc == 3 && strcmp(argv[1], "--files") == 0) {
        files = argv[2];
        argc = 1;
    } else {
        printf("#include \"tests/cross/cross.h\"\n");
    }
    for (int i = 1; i < argc; i++) {
        char *path = strchr(argv[i], '=');
        FILE *f = path == NULL ? NULL : fopen(path + 1, "rb");
        if (f == NULL) {
            fprintf(stderr, "cross_gen: %s: expected NAME=FILE of a table image\n", argv[i]);
            return 2;
        }
        *path = 0;
        put(argv[i], fread(image, 1, sizeof image, f));
        fclose(f);
    }
    for (uint32_t joints = 1; joints <= HDT_JOINTS_MAX; joints += joints == 1 ? 1 : joints == 2 ? 5 : 9) {
        char name[16], *where = NULL;
        int joint;
        ref_random_arm(&r, joints, &tables);
        if (hdt_tables_check(&tables, (const char **)&where, &joint) != HDT_TABLES_OK) {
            fprintf(stderr, "cross_gen: random arm of %u joints: %s of joint %d is refused\n", joints, where,
                    joint);
            return 1;
        }
        snprintf(name, sizeof name, "random%u", joints);
        put(name, hdt_tables_write(&tables, image, sizeof image));
    }
    if (files != NULL)
        return 0;
    printf("const struct cross_image cross_image[] = {\n%s};\n", list);
    printf("const unsigned cross_images = sizeof cross_image / sizeof *cross_image;\n");
    return 0;
}
