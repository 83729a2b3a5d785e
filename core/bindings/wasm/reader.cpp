// Opens a file that the page reads: the module imports the function that gives bytes.
#include "pdeanim.h"

extern "C" {

__attribute__((import_module("pdeanim"), import_name("read"))) int64_t pdeanim_page_read(void *user, uint64_t offset,
                                                                                         void *into, size_t size);

// `user` is handed to the page's function, as the number of the file.
__attribute__((export_name("pdeanim_open_page"))) pdeanim_status pdeanim_open_page(void *user, uint64_t size,
                                                                                   const pdeanim_options *options,
                                                                                   pdeanim_animation **animation,
                                                                                   pdeanim_error *error) {
    return pdeanim_open_read(pdeanim_page_read, user, size, options, animation, error);
}
}
