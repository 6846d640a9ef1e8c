/// <reference types="vite/client" />

/** The version of the service that the page was built with. */
declare const __FVS_VERSION__: string;
